"""What a card says of the numbers in a dataset, and that its code runs as it stands there."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tiny_registry

from dynreg.report.stored import tables


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


def test_a_csv_has_the_parameters_of_its_entries_beside_it(exported, tmp_path: Path) -> None:
    entries = pd.read_csv(exported.folder / "csv.entries.csv")
    frame = exported.opened.population(exported.population)
    for name in ("id", "resistance", "own_loss", "train_loss"):
        assert entries[name].tolist() == frame[name].tolist()
    assert set(pd.read_csv(exported.folder / "csv")["entry"]) == set(entries["id"])
    assert "`csv.entries.csv`" in card_of(exported.folder / "csv")
    exported.opened.export_dataset("bench", tmp_path / "bench.csv", "csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bench.csv", "bench.csv.md"]
    assert "entries.csv" not in card_of(tmp_path / "bench.csv")
    assert "of a file whose name ends in .csv" in card_of(tmp_path / "bench.csv")


def test_the_code_of_a_csv_card_counts_each_episode_of_each_entry(exported, tmp_path: Path) -> None:
    assert "Length: 480" in run_card(exported.folder / "csv")
    exported.opened.export_dataset("bench", tmp_path / "bench.csv", "csv")
    assert run_card(tmp_path / "bench.csv").count(" 200\n") == 5


@pytest.mark.parametrize("form", ["parquet", "csv", "lerobot", "safetensors"])
def test_a_card_says_what_simulated_and_what_the_losses_are(form: str, exported) -> None:
    text = card_of(exported.folder / form)
    assert "Simulated by the engine `joint` with a time step of 0.0025 s." in text
    assert "without noise of sensors" in text
    assert "One episode in 5 of an entry was held out" in text and "the numbers 4, 9 and so on" in text
    assert "`own_loss` is the model's mean squared error on the held-out episodes" in text
    assert ("Its `id` is the `entry` of the rows." in text) == (form in ("parquet", "csv"))


def test_a_card_lists_the_columns_that_there_are(exported, tmp_path: Path) -> None:
    def columns(place: Path) -> list[str]:
        lines = card_of(place).partition("| column |")[2].partition("\n\n")[0].splitlines()[2:]
        return [line.split(" | ")[0].removeprefix("| ") for line in lines]

    assert columns(exported.folder / "csv") == list(pd.read_csv(exported.folder / "csv"))
    assert columns(exported.folder / "parquet") == list(pd.read_parquet(exported.folder / "parquet" / "data"))
    exported.opened.export_dataset("bench", tmp_path / "bench.csv", "csv")
    assert columns(tmp_path / "bench.csv")[:3] == ["episode", "time", "arm/position"]


@pytest.mark.parametrize("form", ["csv", "mcap"])
def test_a_card_of_a_log_lists_what_its_log_has(form: str, exported, tmp_path: Path) -> None:
    columns = [name for name in tiny_registry.COLUMNS if name not in ("kp", "supply")]
    kept = [tiny_registry.COLUMNS.index(name) for name in columns]
    text = tiny_registry.bench_csv(lambda _, row: [row[i] for i in kept], columns)
    (tmp_path / "little.csv").write_text(text)
    exported.opened.ingest(tmp_path / "little.csv", "servo_pendulum", name="little")
    exported.opened.export_dataset("little", tmp_path / f"log.{form}", form)
    lines = card_of(tmp_path / f"log.{form}").partition("| column |")[2].partition("\n\n")[0].splitlines()[2:]
    keys = ["episode", "time"] if form == "csv" else ["time"]
    assert [line.split(" | ")[0].removeprefix("| ") for line in lines] == [
        *keys,
        "arm/position",
        "arm/velocity",
        "arm/target",
    ]
    assert "| arm/target | rad | action |" in lines
    said = card_of(tmp_path / f"log.{form}")
    assert "the columns of its log and no others" in said and "nominal value stands" not in said
    if form == "csv":
        assert list(pd.read_csv(tmp_path / "log.csv")) == [
            *keys,
            "arm/position",
            "arm/velocity",
            "arm/target",
        ]


@pytest.mark.parametrize(
    "form, says",
    [
        ("parquet", "What was not measured is NaN, or null."),
        ("csv", "What was not measured is nan, or empty."),
        ("mcap", "What was not measured is left out of its message."),
        ("lerobot", "What was not measured is NaN."),
        ("minari", "What was not measured is NaN; total_steps counts the steps with NaN, too."),
    ],
)
def test_a_card_says_how_what_was_not_measured_stands_and_what_is_counted(form, says, exported, tmp_path):
    opened, whole = exported.opened, exported.opened.recording("bench")
    values = [e.values.copy() for e in whole.episodes]
    values[1][50, 0] = np.nan
    episodes = tuple(replace(e, values=v) for e, v in zip(whole.episodes, values, strict=True))
    opened.ingest(replace(whole, episodes=episodes), "servo_pendulum", name="gap")
    told = opened.export_dataset("gap", tmp_path / f"gap.{form}", form)
    card = card_of(tmp_path / f"gap.{form}")
    assert f"- {says}" in card and "| transitions | 993 |" in card
    assert "A transition is counted where everything in it was measured" in card
    assert "993 complete transitions" in str(tables(told))
    if form == "csv":
        assert pd.read_csv(tmp_path / "gap.csv")["arm/position"].isna().sum() == 1
    if form == "minari":
        about = json.loads((tmp_path / "gap.minari" / "data" / "metadata.json").read_text())
        assert about["total_steps"] == 5 * 199


@pytest.mark.parametrize("form", ["parquet", "csv", "lerobot"])
def test_a_card_tells_of_the_last_command_of_each_kind(form: str, exported) -> None:
    text = card_of(exported.folder / form)
    assert "A simulated episode ends with a state that no command follows: that frame repeats" in text or (
        "A simulated episode ends with a state that no command follows: the command in that row is" in text
    )
    assert "A recording has the commands of its log in every row, also in the last." in text


def test_an_mcap_card_tells_how_it_comes_back(exported) -> None:
    text = card_of(exported.folder / "mcap")
    assert "named by their number" in text and "has another id" in text
    assert "takes every log as a measured recording, also that of a simulated entry" in text


def test_a_csv_card_tells_how_it_comes_back(exported) -> None:
    assert "one that was simulated comes back with another id" in card_of(exported.folder / "csv")


def test_the_head_of_a_parquet_card_names_its_tables(exported) -> None:
    head = card_of(exported.folder / "parquet").split("---\n")[1]
    assert '- config_name: rows\n  data_files: "data/*.parquet"\n  default: true\n' in head
