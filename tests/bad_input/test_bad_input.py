"""Every bad input gives one clear line and the right exit status, and leaves the registry as it was."""

import os
import re
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from bad_inputs import ALL, ARGUMENTS, LOGS, SETTINGS, Bad
from tiny_registry import bench_csv

from dynreg.cli.main import main
from dynreg.sim.robot import packaged_robots

LINE = re.compile(r"error: \S.*; expected \S.*; \S.*\n")


@pytest.fixture
def place(tmp_path: Path, registry_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a registry of its own in it, where no setting comes from outside."""
    for name in [name for name in os.environ if name.startswith("DYNREG_")]:
        monkeypatch.delenv(name)
    shutil.copytree(registry_folder, tmp_path / "dynreg-registry")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def lay_out(case: Bad, place: Path) -> list[str]:
    """Put the case's files into place and return its command line."""
    if (
        case.robot
        or any(name.startswith("robot/model") for name in case.files)
        and "without" not in case.title
    ):
        shutil.copytree(packaged_robots()["servo_pendulum"], place / "robot")
    toml = place / "robot" / "robot.toml"
    for old, new in case.robot:
        text = toml.read_text(encoding="utf-8")
        assert old in text, f"{old!r} is no longer in servo_pendulum's robot.toml"
        toml.write_text(text.replace(old, new, 1), encoding="utf-8")
    for name, data in case.files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(data.encode() if isinstance(data, str) else data)
    case.prepare(place, place / "dynreg-registry")
    return case.line.format(tmp=place).split(" ")


@pytest.mark.parametrize("case", ALL, ids=lambda case: case.title)
def test_a_bad_input_is_one_clear_line(
    case: Bad,
    place: Path,
    registry_snapshot: Callable[[Path], dict[str, str]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = lay_out(case, place)
    for name, value in case.environment.items():
        monkeypatch.setenv(name, value)
    before, around = registry_snapshot(place / "dynreg-registry"), sorted(os.listdir(place))
    capsys.readouterr()
    status = main(line)
    err = capsys.readouterr().err
    assert LINE.fullmatch(err), err
    assert case.says.replace("{tmp}", str(place)) in err
    assert "this is a bug" not in err
    assert status == case.status, err
    assert registry_snapshot(place / "dynreg-registry") == before
    assert sorted(os.listdir(place)) == around


def test_a_channel_that_never_moves_is_told_not_refused(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = bench_csv(lambda i, row: [row[0], 0.25, *row[2:]])
    (place / "run.csv").write_text(still, encoding="utf-8")
    assert main(["ingest", "run.csv", "--robot", "servo_pendulum"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert re.search(r"(info|warning): .*arm/position.*0\.25", told), told


def test_there_are_many_and_each_has_a_title_of_its_own() -> None:
    assert len(ALL) >= 100
    assert len({case.title for case in ALL}) == len(ALL)


@pytest.mark.parametrize("case", [LOGS[0], ARGUMENTS[0], SETTINGS[0]], ids=lambda case: case.title)
def test_the_real_program_says_the_same(case: Bad, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = lay_out(case, place)
    status, err = main(line), capsys.readouterr().err
    program = [sys.executable, "-c", "from dynreg.cli.main import run; run()"]
    ended = subprocess.run([*program, *line, "--json"], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr, ended.stdout) == (status, err, "")


def test_a_registry_without_write_access_refuses_to_grow(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    registry = place / "dynreg-registry"
    folders = [registry, *(p for p in registry.rglob("*") if p.is_dir())]
    for folder in folders:
        folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    try:
        if os.access(registry, os.W_OK):
            pytest.skip("this user may write everywhere")
        assert main(["list"]) == 0
        capsys.readouterr()
        assert main(["populate", "servo_pendulum", "-n", "2"]) == 1
        assert "read-only" in capsys.readouterr().err
    finally:
        for folder in folders:
            folder.chmod(stat.S_IRWXU)
