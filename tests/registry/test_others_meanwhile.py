"""What another process may do, or may have left undone, between two steps of this one."""

import os
import shutil
import sqlite3
from pathlib import Path
from types import SimpleNamespace

import pytest
from registry_contents import make_population

from dynreg.errors import CorruptError
from dynreg.registry import Registry, disk, opening, verify
from dynreg.registry.files import temporary_folder, try_lock


@pytest.fixture
def synced(monkeypatch) -> list[str]:
    """Names of the folders that are brought to the disk."""
    names: list[str] = []
    sync = disk.sync_folder

    def noted(folder: Path) -> None:
        names.append(folder.name)
        sync(folder)

    monkeypatch.setattr(disk, "sync_folder", noted)
    return names


def _sql(path: Path, statement: str) -> None:
    connection = sqlite3.connect(path)
    with connection:
        connection.execute(statement)
    connection.close()


def test_a_catalogue_that_is_replaced_while_it_is_opened_is_opened_again(registry, tmp_path, monkeypatch):
    """A repair in another process gives the name to a new file; nothing may be put into the old one."""
    catalog = registry.directory.catalog
    shutil.copy(catalog.path, tmp_path / "new")
    _sql(tmp_path / "new", "PRAGMA user_version = 7")
    connect, engine = catalog._engine.connect, catalog._engine

    def replaced():
        connection = connect()
        if (tmp_path / "new").exists():
            os.replace(tmp_path / "new", catalog.path)
        return connection

    monkeypatch.setattr(catalog, "_engine", SimpleNamespace(connect=replaced, dispose=engine.dispose))
    with catalog.transaction("BEGIN IMMEDIATE") as connection:
        assert connection.exec_driver_sql("PRAGMA user_version").scalar() == 7


def test_a_page_of_a_process_that_was_cut_short_is_synced_before_it_is_followed(registry, tmp_path, synced):
    shutil.copy(registry.directory.catalog.path, tmp_path / "before")
    registry.put_simulator({"a": 1})
    shutil.copy(tmp_path / "before", registry.directory.catalog.path)
    synced.clear()
    assert len(registry.ids("simulator")) == 2
    assert synced == ["ledger"]


def test_a_file_of_a_process_that_was_cut_short_is_synced_before_it_is_registered(
    registry, monkeypatch, synced
):
    with monkeypatch.context() as killed, pytest.raises(KeyboardInterrupt):
        killed.setattr(
            "dynreg.registry.catalog.write_page", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)
        )
        registry.put_simulator({"a": 1})
    synced.clear()
    registry.put_simulator({"a": 1})
    assert synced == ["simulators", "ledger"]


def test_folders_of_a_process_that_was_cut_short_are_synced_when_a_registry_is_opened(registry, synced):
    with Registry.open(registry.path):
        assert registry.path.name in synced


def test_a_temporary_folder_that_is_swept_at_once_is_made_again(tmp_path, monkeypatch):
    make, made = disk.make_folder, []

    def swept(folder: Path) -> None:
        make(folder)
        if folder.name.startswith(".out"):
            made.append(folder)
        if made == [folder]:
            folder.rmdir()

    monkeypatch.setattr(disk, "make_folder", swept)
    with temporary_folder(tmp_path / "out") as place:
        assert place.is_dir() and place == made[1]
        with try_lock(place) as mine:
            assert not mine, "it is held"
    assert list(tmp_path.iterdir()) == []


def test_a_copy_of_a_catalogue_that_is_written_meanwhile_is_made_again(registry, monkeypatch):
    """The catalogue and its log are copied one after the other, and the owner folds the log in between them."""
    held = sqlite3.connect(registry.directory.catalog.path)
    held.execute("SELECT * FROM files").fetchone()  # keeps the log from being folded in
    registry.put_population(make_population(12))
    simulator = registry.put_simulator({"a": 1})
    copy, copied = shutil.copyfile, []

    def folded_in(source: Path, target: Path) -> None:
        copy(source, target)
        copied.append(source)
        if len(copied) == 1:
            held.close()
            registry.put_simulator({"a": 2})  # the last one who leaves folds it in

    monkeypatch.setattr("dynreg.registry.opening.shutil.copyfile", folded_in)
    monkeypatch.setattr(opening, "may_write", lambda path: False)
    with Registry.open(registry.path) as reader:
        assert reader.simulator(simulator) == {"a": 1} and len(reader.ids("simulator")) == 3


def test_a_mount_that_is_read_only_is_seen(registry, monkeypatch):
    assert opening.may_write(registry.path)
    monkeypatch.setattr(os, "statvfs", lambda path: SimpleNamespace(f_flag=os.ST_RDONLY))
    assert not opening.may_write(registry.path)
    with Registry.open(registry.path) as reader:
        assert reader.read_only


def test_a_catalogue_of_format_1_with_a_row_that_nobody_wrote_is_refused_and_repaired(path):
    shutil.unpack_archive(Path(__file__).with_name("format_1.zip"), path)
    _sql(path / "catalog.sqlite", "UPDATE robots SET name = x'ff00'")
    with pytest.raises(CorruptError, match="name = "):
        Registry.open(path)
    assert [fault.kind for fault in verify(path).faults if fault.lost] == ["row"]
    verify(path, repair=True)
    assert verify(path).faults == ()
    with Registry.open(path) as registry:
        assert list(registry.robots().values()) == ["arm"] and len(registry.load("bench")) == 10


def test_a_virtual_table_is_no_table_of_the_catalogue(registry):
    _sql(registry.directory.catalog.path, "DROP TABLE results")
    _sql(
        registry.directory.catalog.path,
        "CREATE VIRTUAL TABLE results USING fts5(id, kind, recording_id, path, ordinal)",
    )
    with pytest.raises(CorruptError, match="it holds the table"):
        registry.recordings()
    verify(registry.path, repair=True)
    assert verify(registry.path).faults == ()


def test_a_page_of_another_ledger_does_not_follow(registry, tmp_path):
    """It has the next number and is whole, but it tells of what came after another page."""
    with Registry.open(tmp_path / "other", create=True) as other:
        for number in range(20):
            other.put_simulator({"a": number})
    number = registry.directory.catalog.last_page() + 1
    (page,) = (tmp_path / "other" / "ledger").glob(f"{number:08d}-*")
    shutil.copy(page, registry.path / "ledger")
    with pytest.raises(CorruptError, match="does not follow"):
        registry.recordings()
    assert "does not follow" in str(verify(registry.path).faults)
    verify(registry.path, repair=True)
    assert verify(registry.path).faults == () and registry.recordings()
