"""What names episodes and tells their settings: the log's own name, and the cells of an episode column."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from dynreg.data.ingest import read_recording
from dynreg.data.maps import parse_map
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.errors import LogError

SPEC = RecordingSpec(
    "arm",
    (ChannelSpec("arm/position", "rad", "state"), ChannelSpec("arm/target", "rad", "action")),
    (),
    100.0,
)
LOADED = replace(SPEC, settings=("payload",))
T = np.arange(200) / 100
SWING = np.sin(3 * T)
CHANNELS = '[channels."arm/position"]\nsource = "{}"\n[channels."arm/target"]\nsource = "{}"\n'
BY_RUN = CHANNELS.format("q", "u") + '[episodes]\nby = "column"\ncolumn = "run"\n'


def dataset(path: Path) -> Path:
    """A LeRobot folder of one episode."""
    (path / "meta").mkdir(parents=True)
    (path / "data").mkdir()
    (path / "meta" / "info.json").write_text(json.dumps({"fps": 100, "features": {}}))
    pq.write_table(pa.table({"timestamp": T, "q": SWING, "u": SWING}), path / "data" / "all.parquet")
    return path


def test_a_dot_in_the_name_of_a_folder_cuts_nothing_off(tmp_path: Path):
    text = CHANNELS.format("q", "u") + '[settings.payload]\nfilename = "payload_([0-9.]+)"\n'
    folders = [dataset(tmp_path / f"payload_{mass}") for mass in ("0.5", "0.7")]
    found = read_recording(folders, LOADED, parse_map(text)).episodes
    assert [(e.name, e.settings) for e in found] == [
        ("payload_0.5", {"payload": 0.5}),
        ("payload_0.7", {"payload": 0.7}),
    ]


def test_a_dot_in_what_the_files_of_an_episode_share_cuts_nothing_off(write_table: Callable):
    text = CHANNELS.format("measured.q", "told.u") + '[settings.payload]\nfilename = "run_([0-9.]+)kg"\n'
    text += (
        '[files]\nmeasured = "_measured.csv"\ntold = "_told.csv"\n[episodes]\nname = "{stem} {payload:g}"\n'
    )
    paths = [
        write_table(f"run_{mass}kg_{member}.csv", time=T, **{name: SWING})
        for mass in ("0.5", "0.7")
        for member, name in (("measured", "q"), ("told", "u"))
    ]
    found = read_recording(paths, LOADED, parse_map(text)).episodes
    assert [(e.name, e.settings) for e in found] == [
        ("run_0.5kg 0.5", {"payload": 0.5}),
        ("run_0.7kg 0.7", {"payload": 0.7}),
    ]


@pytest.mark.parametrize("first", [0, 1])
def test_without_a_map_each_log_has_its_own_episodes(first: int, write_table: Callable):
    columns = {"arm__position": SWING, "arm__target": SWING}
    whole = write_table("whole.csv", time=T, **columns)
    parts = write_table("parts.csv", time=T + 10, **columns, episode=np.arange(200) // 50)
    recording = read_recording([whole, parts] if first == 0 else [parts, whole], SPEC)
    assert [e.name for e in recording.episodes] == ["whole", "0", "1", "2", "3"]
    assert recording.provenance["map"]["episodes"] == {"by": "column", "column": "episode"}


@pytest.mark.parametrize("names", [("1", "2"), ("slow", "fast")])
def test_rows_between_runs_belong_to_no_episode_and_are_counted(
    names: tuple[str, str], write_table: Callable
):
    first, second = names
    run = [first] * 80 + [""] * 30 + [second] * 90
    recording = read_recording(write_table(time=T, q=SWING, u=SWING, run=run), SPEC, parse_map(BY_RUN))
    assert [(e.name, len(e.time)) for e in recording.episodes] == [(first, 80), (second, 90)]
    (told,) = [f for f in recording.provenance["findings"] if f["check"] == "left_out"]
    assert told["severity"] == "info" and told["where"] == "log.csv, run"
    assert told["message"] == "30 of 200 rows name no episode: they are left out"


def test_an_episode_column_without_a_cell_is_one_line(write_table: Callable):
    path = write_table(time=T, q=SWING, u=SWING, run=[""] * 200)
    with pytest.raises(LogError, match=r"column 'run' of 'log\.csv' is empty in every row"):
        read_recording(path, SPEC, parse_map(BY_RUN))


def test_the_number_of_an_episode_keeps_its_digits(write_table: Callable):
    run = np.repeat([20240115, 20240116, 20240117, 20240118], 50)
    path = write_table(time=T, q=SWING, u=SWING, run=run)
    found = read_recording(path, SPEC, parse_map(BY_RUN)).episodes
    assert [e.name for e in found] == ["20240115", "20240116", "20240117", "20240118"]
    path = write_table(time=T, q=SWING, u=SWING, run=np.repeat([0.1234567, 0.1234568], 100))
    found = read_recording(path, SPEC, parse_map(BY_RUN)).episodes
    assert [e.name for e in found] == ["0.1234567", "0.1234568"]
