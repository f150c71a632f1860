"""The one place where the registry changes the disk: each change is whole, lasts, or is refused in a sentence."""

import errno
import os

import pytest
from portalocker import LockException

import dynreg.registry.disk as disk
from dynreg.errors import NoPlaceError, RegistryError
from dynreg.registry.files import try_lock, write_file


def test_all_is_written_however_little_the_system_takes_at_once(tmp_path, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:3]))
    descriptor = disk.create(tmp_path / "new")
    disk.write(descriptor, b"0123456789")
    disk.sync(descriptor)
    os.close(descriptor)
    assert (tmp_path / "new").read_bytes() == b"0123456789"
    with pytest.raises(FileExistsError):
        disk.create(tmp_path / "new")


def test_a_rename_takes_the_place_of_what_was_there(tmp_path):
    (tmp_path / "old").write_text("new")
    (tmp_path / "there").write_text("before")
    disk.rename(tmp_path / "old", tmp_path / "there")
    assert (tmp_path / "there").read_text() == "new" and not (tmp_path / "old").exists()
    with pytest.raises(FileNotFoundError):
        disk.rename(tmp_path / "old", tmp_path / "there")


def test_what_is_there_or_gone_already_is_no_error(tmp_path):
    disk.remove(tmp_path / "nothing")
    disk.make_folder(tmp_path / "a" / "b")
    disk.make_folder(tmp_path / "a" / "b")
    disk.remove_folder(tmp_path / "a" / "b")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


REFUSED = {
    "cannot create": lambda path: disk.make_folder(path / "file" / "below"),
    "cannot remove .*file": lambda path: disk.remove(path / "file" / "below"),
    "cannot remove .*full": lambda path: disk.remove_folder(path / "full"),
    "cannot sync": lambda path: disk.sync_folder(path / "nowhere"),
    "cannot rename to": lambda path: disk.rename(path / "file", path / "full"),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_the_system_refuses_is_a_sentence(message, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "full" / "of").mkdir(parents=True)
    with pytest.raises(
        RegistryError, match=f"^{message}.*; expected a place that may be written.*; free some space"
    ):
        REFUSED[message](tmp_path)


@pytest.mark.parametrize("cause", [OSError(errno.EOPNOTSUPP, "Operation not supported"), EOFError()])
def test_a_file_system_without_locks_is_refused_in_a_sentence(cause, tmp_path, monkeypatch):
    def no_lock(*_: object) -> None:
        raise LockException(str(cause)) from cause

    monkeypatch.setattr("portalocker.lock", no_lock)
    told = os.strerror(getattr(cause, "errno", errno.ENOLCK))
    with pytest.raises(NoPlaceError, match=f"cannot write .*: {told}; expected a place"):
        write_file(tmp_path / "new", b"")
    with pytest.raises(NoPlaceError, match=f"cannot lock .*: {told}; expected a place"), try_lock(tmp_path):
        pass


def test_where_no_folder_can_be_opened_its_names_are_left_to_the_system(tmp_path, monkeypatch):
    """As on Windows, where every put ended in an error."""
    from types import SimpleNamespace

    monkeypatch.setattr(disk, "os", SimpleNamespace(name="nt"))
    disk.sync_folder(tmp_path)
