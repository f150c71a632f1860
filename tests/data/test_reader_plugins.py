"""The table of log formats: packaged ones by bytes, suffix or folder, and those of installed packages."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.readers import LogFormat, format_of, formats, read_log
from dynreg.errors import RobotError

READER = """
import numpy as np
from dynreg.data.readers import LogFormat
from dynreg.data.series import RawLog, Series

TAPE = LogFormat("tape", "tapes", magic=(b"TAPE",), suffixes=(".tap",), folder=("reel.txt", "tape"))
TAKEN = LogFormat("csv", "tapes")
LIKE = LogFormat("like", "tapes", magic=(b"PAR1",), suffixes=(".like",))

def read(path, options):
    values = np.array([float(x) for x in path.read_text().split()[1:]])
    return RawLog(path, {"arm": Series(np.arange(len(values)) * 0.1, values)})
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator:
    """Installs a package whose entry point names something of the reader above."""

    def put(what: str) -> None:
        (tmp_path / "tapes.py").write_text(READER)
        about = tmp_path / "tapes-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: tapes\nVersion: 1.0\n")
        (about / "entry_points.txt").write_text(f"[dynreg.readers]\ntape = tapes:{what}\n")
        monkeypatch.syspath_prepend(str(tmp_path))
        formats.cache_clear()

    yield put
    formats.cache_clear()
    sys.modules.pop("tapes", None)


def test_a_reader_of_an_installed_package_is_picked_by_bytes_suffix_and_folder(install, tmp_path: Path):
    install("TAPE")
    (tmp_path / "run.dat").write_text("TAPE 1 2 3")
    (tmp_path / "run.tap").write_text("tape 4 5 6")
    (tmp_path / "reel").mkdir()
    (tmp_path / "reel" / "reel.txt").touch()
    assert np.array_equal(read_log(tmp_path / "run.dat").sources["arm"].values, [1, 2, 3])
    assert np.array_equal(read_log(tmp_path / "run.tap").sources["arm"].values, [4, 5, 6])
    assert format_of(tmp_path / "reel").name == "tape" == list(formats())[-1]


def test_of_formats_that_begin_alike_the_suffix_decides(install, tmp_path: Path):
    install("LIKE")
    for name in ("run.like", "run.parquet", "run.dat"):
        (tmp_path / name).write_bytes(b"PAR1 and more")
    told = [format_of(tmp_path / name).name for name in ("run.like", "run.parquet", "run.dat")]
    assert told == ["like", "parquet", "parquet"]


@pytest.mark.parametrize(
    ("what", "told"),
    [("TAKEN", "'csv'.*not taken"), ("read", "LogFormat"), ("LOST", "tapes:LOST cannot be loaded")],
)
def test_what_is_no_new_format_is_named(install, what: str, told: str):
    install(what)
    with pytest.raises(RobotError, match=told):
        formats()


def test_no_two_formats_are_told_by_the_same():
    packaged = formats().values()
    marks = [mark for f in packaged for mark in (*f.magic, *f.suffixes, *([f.folder[0]] if f.folder else []))]
    assert len(marks) == len(set(marks)) and all(isinstance(f, LogFormat) for f in packaged)
