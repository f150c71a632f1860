"""A cell of text in a column of numbers is empty and counted; a column of text is named where numbers are asked for."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.ingest import doctor, read_log, read_recording
from dynreg.data.logfile import LogFile
from dynreg.data.maps import parse_map
from dynreg.data.readers import tables
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.errors import MapError

SPEC = RecordingSpec("one", (ChannelSpec("q", "rad", "state"),), (), 100.0)
MAP = parse_map('[channels.q]\nsource = "q"\n')
T = np.arange(200) / 100
LINES = [f"{t:.2f},{np.sin(3 * t):.5f}" for t in T.tolist()]


def _log(lines: list[str]) -> LogFile:
    return LogFile(Path("run.csv"), "\n".join(["time,q", *lines]).encode())


@pytest.mark.parametrize("log_map", [None, MAP], ids=["no map", "a map"])
def test_a_word_among_numbers_is_an_empty_cell_that_is_counted(log_map: object, write_table: Callable):
    q = [*np.sin(3 * T).tolist()]
    q[120] = "ERR"
    path = write_table(time=T, q=np.array(q, dtype=object))
    recording = read_recording(path, SPEC, log_map)
    assert len(recording.episodes[0].time) == 200
    (told,) = [f for f in recording.provenance["findings"] if f["check"] == "left_out"]
    assert told["where"] == "log.csv, q" and "'ERR' in row 121 (1 of 200 are no numbers)" in told["message"]
    assert "left_out" in {f.check for f in doctor(path)}
    values = read_log(path).sources["q"].values
    assert np.flatnonzero(np.isnan(values)).tolist() == [120]
    np.testing.assert_allclose(np.delete(values, 120), np.delete(np.sin(3 * T), 120))


def test_a_word_far_down_keeps_whole_stamps_and_all_other_numbers(monkeypatch: pytest.MonkeyPatch):
    lines = [f"{1_700_000_000_000_000_001 + k},{k}" for k in range(100)]
    lines[80], lines[90] = "-,80", "1700000000000000091,E"
    monkeypatch.setattr(tables, "BLOCK", 300)
    log = LogFile(Path("run.csv"), "\n".join(["time_ns,q", *lines]).encode())
    series = read_log(log).sources["q"]
    np.testing.assert_array_equal(series.time, np.where(np.arange(100) == 80, np.nan, np.arange(100) * 1e-9))
    np.testing.assert_array_equal(series.values, np.where(np.arange(100) == 90, np.nan, np.arange(100)))


def test_a_log_that_ends_within_a_number_is_read(tmp_path: Path):
    log = read_log(_log([*LINES[:-1], "1.99,-"]))
    assert np.isnan(log.sources["q"].values[-1]) and np.isfinite(log.sources["q"].values[:-1]).all()


def test_decimal_commas_are_read_beside_a_word():
    lines = [line.replace(",", ";").replace(".", ",") for line in LINES]
    lines[50] = "0,50;ERR"
    log = read_log(LogFile(Path("run.csv"), "\n".join(["time;q", *lines]).encode()))
    np.testing.assert_allclose(
        np.delete(log.sources["q"].values, 50), np.delete(np.sin(3 * T), 50), atol=1e-5
    )


def test_numbers_name_episodes_as_they_are_written(write_table: Callable):
    text = '[channels.q]\nsource = "q"\n[episodes]\nby = "column"\ncolumn = "run"\n'
    run = np.repeat(["01", "02", "2b", "03"], 50)
    found = read_recording(write_table(time=T, q=np.sin(3 * T), run=run), SPEC, parse_map(text)).episodes
    assert [e.name for e in found] == ["01", "02", "2b", "03"]


@pytest.mark.parametrize("log_map", [None, MAP], ids=["no map", "a map"])
def test_a_column_of_text_is_said_to_be_one(log_map: object, write_table: Callable):
    path = write_table(time=T, q=np.where(np.arange(200) < 50, "0.5", "high"))
    with pytest.raises(
        MapError, match=r"column 'q' holds text: 'high' in row 51 \(150 of 200 are no numbers\)"
    ):
        read_recording(path, SPEC, log_map)


@pytest.mark.parametrize("comment", ["# the operator paused", "# s,rad", "# gain, mass, load"])
@pytest.mark.parametrize("row", [0, 100])
def test_a_comment_among_the_rows_is_no_row(comment: str, row: int):
    log = read_log(_log([*LINES[:row], comment, *LINES[row:]])).stamped()
    np.testing.assert_allclose(log.sources["q"].time, T, atol=1e-9)
    np.testing.assert_allclose(log.sources["q"].values, np.sin(3 * T), atol=1e-5)
