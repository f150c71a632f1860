"""Robot folders written by the tests."""

from collections.abc import Callable
from pathlib import Path

import pytest
from arm_robot import ARM_TOML, ARM_XML

from dynreg.sim.engines import compiling


@pytest.fixture
def write_robot(tmp_path: Path) -> Callable[..., Path]:
    """Writes a robot folder: the arm's, with text replaced in robot.toml and parameters of one's own."""

    def write(*changes: tuple[str, str], parameters: str | None = None, xml: str = ARM_XML) -> Path:
        folder = tmp_path / f"robot{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        text = ARM_TOML
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        if parameters is not None:
            text = text[: text.index("[[parameters]]")] + parameters
        (folder / "robot.toml").write_text(text)
        (folder / "model.xml").write_text(xml)
        return folder

    return write


@pytest.fixture
def own_effects_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A test's effects are compiled without the packaged ones, which it does not need: in less time."""
    monkeypatch.setattr(compiling, "_table", tuple)
