"""What an export says, refuses and leaves behind."""

import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from dynreg.cli.main import main
from dynreg.data.recording import Episode
from dynreg.data.table import write_parquet
from dynreg.datasets.card import card
from dynreg.datasets.formats import FORMATS, format_of
from dynreg.errors import NoMatchError, UsageError
from dynreg.report.stored import tables
from dynreg.results import DatasetExport
from dynreg.verbs.export_dataset import contents
from dynreg.verbs.ingest import recording_summary


def card_of(place: Path) -> str:
    return (place / "README.md" if place.is_dir() else Path(f"{place}.md")).read_text(encoding="utf-8")


@pytest.mark.parametrize("form", FORMATS)
def test_a_card_tells_what_is_in_it(form: str, exported) -> None:
    text = card_of(exported.folder / form)
    head = yaml.safe_load(text.split("---\n")[1])
    assert head["license"] == "apache-2.0" and "robotics" in head["tags"]
    for told in (
        "12 simulated entries",
        "levels, chirp, triangle, drop",
        "| resistance | ohm | 2.5 to 8 | log |",
        "| arm/velocity | rad/s | state |",
        f"| population | {exported.population} |",
        "mujoco 4",
        f"pip install {FORMATS[form].loader}",
    ):
        assert told in text, told
    rows = ("| episodes | 480 |", "| transitions | 24000 |", "| rate | 100 Hz |", "| time | s | key |")
    models = ("| models | 12 |", "| inputs | 7 |", "| outputs | 2 |", "## Outputs")
    assert all((told in text) == (form != "safetensors") for told in rows)
    assert all((told in text) == (form == "safetensors") for told in models)
    assert str(exported.folder) not in text


def test_a_card_of_a_recording_names_its_files_and_no_licence(exported, tmp_path: Path) -> None:
    told = exported.opened.export_dataset(["bench", exported.population], tmp_path / "both", "parquet")
    text = card_of(tmp_path / "both")
    assert "1 real recording" in text and "| bench | measured | bench.csv |" in text
    assert "No licence is stated" in text and "license" not in yaml.safe_load(text.split("---\n")[1])
    assert (told.entries, told.recordings, told.episodes, told.transitions) == (12, 1, 485, 24995)
    files = [file for file in (tmp_path / "both").rglob("*") if file.is_file()]
    assert told.bytes == sum(file.stat().st_size for file in files)
    exported.opened.export_dataset("bench", tmp_path / "own", "parquet", licence="ask | me <b>")
    head = yaml.safe_load(card_of(tmp_path / "own").split("---\n")[1])
    assert (head["license"], head["license_name"]) == ("other", "ask | me <b>")
    assert "ask \\| me &lt;b>" in card_of(tmp_path / "own")


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_export_gives_the_same_bytes(form: str, exported, tmp_path, registry_snapshot) -> None:
    refs = exported.population
    exported.opened.export_dataset(refs, tmp_path / form, form, licence="apache-2.0")
    again = registry_snapshot(tmp_path)
    first = registry_snapshot(exported.folder)
    mine = {
        n: h
        for n, h in first.items()
        if n.split("/")[0] in (form, f"{form}.md", f"{form}.toml", f"{form}.entries.csv")
    }
    assert again == mine


@pytest.mark.parametrize(
    "refs, form, kind, says",
    [
        (["nothing"], "parquet", NoMatchError, "nothing"),
        ([], "parquet", UsageError, "a dataset of nothing"),
        (["bench"], "hdf", UsageError, "one of 'parquet', 'csv'"),
        (
            ["bench"],
            "safetensors",
            UsageError,
            "recordings as safetensors; expected entries of one population",
        ),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(refs, form, kind, says, exported, tmp_path: Path) -> None:
    with pytest.raises(kind, match=says):
        exported.opened.export_dataset(refs, tmp_path / "out", form)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", FORMATS)
def test_a_name_that_is_taken_is_refused(form: str, exported, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(
        UsageError, match="out' exists already; expected a name that is not taken; name another"
    ):
        exported.opened.export_dataset(exported.population, tmp_path / "out", form)
    with pytest.raises(UsageError, match="cannot write .*No such file"):
        exported.opened.export_dataset(exported.population, tmp_path / "no" / "out", form)
    assert [p.name for p in tmp_path.iterdir()] == ["out"] and (tmp_path / "out").read_text() == "mine"


def test_a_card_of_someone_else_beside_a_file_is_not_written_over(exported, tmp_path: Path) -> None:
    (tmp_path / "out.csv.md").write_text("mine")
    with pytest.raises(UsageError, match="out.csv.md.*exists already"):
        exported.opened.export_dataset("bench", tmp_path / "out.csv", "csv")
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv.md"]
    (tmp_path / "out.mcap.toml").write_text("mine")
    with pytest.raises(UsageError, match="out.mcap.toml.*exists already"):
        exported.opened.export_dataset("bench", tmp_path / "out.mcap", "mcap")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.csv.md", "out.mcap.toml"]
    (tmp_path / "out.mcap.toml").unlink()
    (tmp_path / "out.csv.md").unlink()
    exported.opened.export_dataset("bench", tmp_path / "out.csv", "csv")
    (tmp_path / "out.csv").unlink()  # as a killed run may leave it
    exported.opened.export_dataset("bench", tmp_path / "out.csv", "csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.csv", "out.csv.md"]


KILLED = """
import os, resource, signal, sys
from dynreg import session
if sys.argv[3] == "kill":
    os.rename = lambda *names: os.kill(os.getpid(), signal.SIGKILL)
with session.open(sys.argv[1], create=False) as opened:
    population = opened.populations().items[0].id
    if sys.argv[3] == "room":
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
    opened.export_dataset(population, "out", sys.argv[2])
"""


@pytest.mark.parametrize("form", ["parquet", "csv"])
@pytest.mark.parametrize("how", ["kill", "room"])
def test_nothing_is_left_half_written(form: str, how: str, registry_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(registry_folder, tmp_path / "registry")
    line = [sys.executable, "-c", KILLED, "registry", form, how]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    left = [p.name for p in tmp_path.iterdir() if p.name != "registry"]
    if how == "kill":
        assert done.returncode == -signal.SIGKILL and len(left) == 1 and left[0].startswith(".out.tmp-")
    else:
        assert "UsageError: cannot write 'out': File too large" in done.stderr, done.stderr
        assert left == []


@dataclass(frozen=True)
class Paced:
    """A part whose episodes have other periods."""

    part: object
    periods: np.ndarray

    def __getattr__(self, name: str):
        return getattr(self.part, name)


def test_a_lerobot_dataset_has_one_rate(exported) -> None:
    told = contents(exported.opened.registry, [exported.population])
    part, _ = told.dataset.parts
    for factor, fits in ((1.002, True), (1.5, False)):
        periods = part.periods.copy()
        periods[3] *= factor
        other = replace(told, dataset=replace(told.dataset, parts=(Paced(part, periods),)))
        if fits:
            format_of("lerobot").check(other)
            continue
        with pytest.raises(UsageError, match="66.67 to 100 Hz as lerobot; expected one rate.*parquet"):
            format_of("lerobot").check(other)


def test_a_recording_of_uneven_times_is_no_lerobot_dataset(exported, tmp_path: Path) -> None:
    told = contents(exported.opened.registry, ["bench"])
    (part,), stored = told.dataset.parts, exported.opened.registry.recording("bench")
    time = np.cumsum(np.tile([0.01, 0.01, 0.15], 20))  # the median tells nothing of it
    last = Episode("timed", time, stored.episodes[0].values[: len(time)], stored.episodes[0].settings)
    recording = replace(stored, episodes=(*stored.episodes, last))
    write_parquet(recording, tmp_path / "uneven.parquet")
    own = replace(part, path=tmp_path / "uneven.parquet")
    other = replace(told, dataset=replace(told.dataset, parts=(own,)))
    with pytest.raises(UsageError, match="'timed' with uneven times as lerobot.*parquet"):
        format_of("lerobot").check(other)
    format_of("parquet").check(other)
    assert "| rate | uneven times" in card(other, format_of("parquet"), "place", 1)
    assert recording_summary("id", stored, "r", "n").rate == pytest.approx(100.0)
    assert recording_summary("id", recording, "r", "n").rate is None


def test_an_export_of_models_counts_models(exported, tmp_path: Path) -> None:
    told = exported.opened.export_dataset(exported.population, tmp_path / "models", "safetensors")
    assert (told.models, told.episodes, told.transitions) == (12, None, None)
    text = str(tables(told))
    assert "12 simulators" in text and "12 models" in text and "transition" not in text


def test_the_command_prints_what_it_wrote(exported, tmp_path: Path, capsys) -> None:
    line = ["export", "bench", "--as", "parquet", "--registry", str(exported.opened.path), "--licence", "mit"]
    assert main([*line, "--to", str(tmp_path / "one"), "--json"]) == 0
    told = DatasetExport.model_validate_json(capsys.readouterr().out)
    assert told.form == "parquet" and told.robot == "servo_pendulum" and told.transitions == 995
    assert main([*line, "--to", str(tmp_path / "two")]) == 0
    assert "1 recording of servo_pendulum as parquet, 5 episodes, 995 complete transitions" in " ".join(
        capsys.readouterr().out.split()
    )
    assert main([*line, "--to", str(tmp_path / "two")]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_place_that_cannot_be_is_named_as_it_was_told(exported, capsys) -> None:
    for form in ("parquet", "csv", "registry"):
        line = ["export", "bench", "--as", form, "--to", "/proc/foo", "--registry", str(exported.opened.path)]
        assert main(line) != 0
        said = capsys.readouterr().err
        assert "cannot write '/proc/foo': " in said and "tmp" not in said
