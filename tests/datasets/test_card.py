"""What a card says of the numbers in a dataset, and that its code runs as it stands there."""

import subprocess
import sys
from pathlib import Path

import pytest


def card_of(place: Path) -> str:
    return (place / "README.md" if place.is_dir() else Path(f"{place}.md")).read_text(encoding="utf-8")


def run_card(place: Path) -> str:
    """What the code of a card prints."""
    (code,) = (part.partition("```")[0] for part in card_of(place).split("```python\n")[1:])
    line = [sys.executable, "-c", code]
    done = subprocess.run(line, cwd=place.parent, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("many", [False, True])
def test_the_code_of_an_mcap_card_runs_for_a_file_and_for_a_folder(many: bool, exported, tmp_path) -> None:
    ids = exported.opened.registry.load(exported.population, ()).ids[: 2 if many else 1]
    place = tmp_path / "logs"
    exported.opened.export_dataset(list(ids), place, "mcap")
    names = [file.name for file in place.glob("*.mcap")] if many else ["logs"]
    said = run_card(place)
    assert len(names) == len(ids) and all(f"{name} /arm " in said for name in names)
