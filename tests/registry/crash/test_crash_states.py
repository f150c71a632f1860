"""The disk that loses power: what was synced is there, of all else any part."""

import os
from pathlib import Path

import pytest
import sqlite_vfs
from recorder import Recorder, recording
from replay import Journal, Tree


@pytest.fixture(autouse=True)
def _sqlite_can_be_watched() -> None:
    try:
        sqlite_vfs.library()
    except OSError as error:
        pytest.skip(str(error))


def _write(path: Path, data: bytes, sync: bool = False) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
    os.write(descriptor, data)
    if sync:
        os.fsync(descriptor)
    os.close(descriptor)


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def _left(root: Path, act) -> list[Tree]:
    """The states that a power cut at the end may leave."""
    with recording(recorder := Recorder(root)):
        act()
    journal = Journal(recorder)
    last = max((c.why.split(":")[0] for c in journal.power_cuts()), key=lambda why: int(why.split()[-1]))
    return [crash.tree for crash in journal.power_cuts() if crash.why.startswith(f"{last}:")]


def test_what_was_synced_is_there_and_its_name_once_the_folder_was(tmp_path):
    path = tmp_path / "a"
    assert {tuple(tree) for tree in _left(tmp_path, lambda: _write(path, b"data", sync=True))} == {(), ("a",)}
    path.unlink()

    def safely() -> None:
        _write(path, b"data", sync=True)
        _sync(tmp_path)

    assert all(tree == {"a": b"data"} for tree in _left(tmp_path, safely))


def test_bytes_that_were_not_synced_may_be_there_torn_or_as_zeros(tmp_path):
    path = tmp_path / "a"

    def named() -> None:
        _write(path, b"data")
        _sync(tmp_path)

    left = {tree["a"] for tree in _left(tmp_path, named)}
    assert {b"", b"data"} <= left <= {b"", b"d", b"da", b"dat", b"data", bytes(4)}


def test_a_rename_is_done_whole_or_not_at_all(tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    _write(old, b"data")
    _write(new, b"before")
    states = _left(tmp_path, lambda: os.replace(old, new))
    assert {(tree.get("old"), tree["new"]) for tree in states} == {(b"data", b"before"), (None, b"data")}


def test_a_folder_that_was_not_synced_in_its_parent_is_lost_with_all_in_it(tmp_path):
    def act() -> None:
        os.mkdir(tmp_path / "deep")
        _write(tmp_path / "deep" / "a", b"data", sync=True)
        _sync(tmp_path / "deep")

    assert {tuple(sorted(tree)) for tree in _left(tmp_path, act)} == {(), ("deep", "deep/a")}


def test_changes_that_do_not_touch_may_come_in_any_order(tmp_path):
    def act() -> None:
        for name in "abc":
            os.mkdir(tmp_path / name)

    assert len({tuple(sorted(tree)) for tree in _left(tmp_path, act)}) == 8


def test_what_nobody_noted_is_not_overlooked(tmp_path):
    """Renaming a file that came to be without the recorder."""
    with recording(recorder := Recorder(tmp_path)):
        (tmp_path / "hidden").write_bytes(b"")  # opened by C code
        os.replace(tmp_path / "hidden", tmp_path / "seen")
    with pytest.raises(KeyError, match="hidden"):
        Journal(recorder)
