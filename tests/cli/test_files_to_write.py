"""Files that a verb is to write are looked at before it spends time."""

import os
from pathlib import Path

import pytest

from dynreg.cli.call import can_write
from dynreg.errors import UsageError


def test_what_cannot_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    can_write(None, tmp_path / "new.csv", tmp_path / "page.html")
    kept = tmp_path / "kept.csv"
    kept.write_text("kept")
    can_write(kept)
    for bad in (tmp_path, tmp_path / "none" / "a.csv"):
        with pytest.raises(UsageError, match="cannot write .* may be written, in an existing folder"):
            can_write(tmp_path / "new.csv", bad)
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) not in (kept, tmp_path))
    for bad in (kept, tmp_path / "new.csv"):
        with pytest.raises(UsageError, match="cannot write"):
            can_write(bad)


def test_one_file_for_two_things_is_refused(tmp_path: Path, dynreg) -> None:
    (tmp_path / "b").mkdir()
    with pytest.raises(UsageError, match="is named twice"):
        can_write(tmp_path / "a.csv", tmp_path / "b" / ".." / "a.csv")
    for verb in ("navigate monday --visit 0.5,0.2", "drift one --against two"):
        ended = dynreg(*verb.split(), "--out", "x.csv", "--report", "x.csv")
        assert ended.status == 2 and "named twice" in ended.err, ended.err
