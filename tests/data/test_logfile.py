"""A log is read from bytes in memory as from a file, and nothing that a library says of it escapes."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag2 import StoragePlugin
from scipy.io import savemat
from test_message_readers import write_bag1, write_bag2, write_cdr_mcap

from dynreg.data import readers
from dynreg.data.logfile import LogFile
from dynreg.data.readers import formats, read_log
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.table import read_parquet, write_csv, write_parquet
from dynreg.errors import LogError

T = np.arange(5) * 0.01


def _db3(path: Path) -> None:
    write_bag2(path.with_suffix(""), StoragePlugin.SQLITE3)
    next(path.with_suffix("").glob("*.db3")).rename(path)


WRITERS: dict[str, Callable[[Path], object]] = {
    "run.csv": lambda p: p.write_text("time,q\n" + "".join(f"{t},{t}\n" for t in T)),
    "run.parquet": lambda p: pq.write_table(pa.table({"time": T, "q": T}), p),
    "run.npz": lambda p: np.savez(p, time=T, q=T),
    "run.mat": lambda p: savemat(p, {"time": T, "q": T}),
    "run.json": lambda p: p.write_text('{"entries": [{"t": 0, "q": 1}, {"t": 1, "q": 2}]}'),
    "run.mcap": write_cdr_mcap,
    "run.bag": write_bag1,
    "run.db3": _db3,
}


@pytest.mark.parametrize("name", WRITERS)
def test_bytes_in_memory_are_read_as_a_file(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / name)
    there, here = read_log(tmp_path / name), read_log(LogFile(Path(name), (tmp_path / name).read_bytes()))
    assert here.path == Path(name) and here.sources.keys() == there.sources.keys()
    for source, series in here.sources.items():
        np.testing.assert_array_equal(series.values, there.sources[source].values)
        np.testing.assert_array_equal(series.time, there.sources[source].time)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    "error", [MemoryError(), RecursionError("deep"), KeyError("x"), OverflowError("large")]
)
def test_whatever_fails_a_reader_is_a_log_error(
    name: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    WRITERS[name](tmp_path / name)
    form = readers.format_of(tmp_path / name)

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(readers.import_module(form.module), "read", fails)
    with pytest.raises(LogError, match=f"'{name}' cannot be read as {form.name}: ."):
        read_log(tmp_path / name)


def test_every_packaged_format_of_one_file_is_tried_here() -> None:
    read = {readers.format_of(LogFile(Path(n), b"?")).name for n in WRITERS}
    assert read == {f.name for f in formats().values() if f.suffixes}


def test_what_never_ends_is_no_log(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "run.csv")
    for path in (tmp_path / "run.csv", Path("/dev/zero")):
        with pytest.raises(LogError, match="neither a file nor a folder"):
            read_log(path)


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.mcap"])
def test_a_colon_in_a_path_makes_no_address(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    WRITERS[name](tmp_path / name)
    path = Path(f"s3:{name}")
    (tmp_path / name).rename(path)
    assert read_log(path).sources


def test_recordings_are_written_and_read_where_a_path_has_a_colon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    recording = Recording((Channel("arm/position", "rad"),), (Episode("a", T, T[:, None]),))
    write_parquet(recording, "s3:run.parquet")
    write_csv(recording, "s3:run.csv")
    assert read_parquet("s3:run.parquet").id == recording.id
    assert len(read_log("s3:run.csv").sources["arm/position"]) == 5
