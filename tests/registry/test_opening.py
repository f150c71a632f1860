"""Opening: any older registry works, anything else is an error that says what to do."""

import json
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from registry_contents import ROBOT, fill, make_recording
from sqlalchemy import create_engine, inspect

from dynreg.errors import CorruptError, RegistryError
from dynreg.registry import Registry, migrations, tables, verify


def _schema(url: str) -> dict:
    inspector = inspect(create_engine(url))
    return {
        name: (
            [(c["name"], str(c["type"]), c["nullable"]) for c in inspector.get_columns(name)],
            inspector.get_pk_constraint(name)["constrained_columns"],
            sorted((k["constrained_columns"], k["referred_table"]) for k in inspector.get_foreign_keys(name)),
            [u["column_names"] for u in inspector.get_unique_constraints(name)],
        )
        for name in inspector.get_table_names()
    }


def test_migrations_lead_to_the_tables_of_the_code(path, tmp_path):
    Registry.open(path, create=True).close()
    declared = create_engine(f"sqlite:///{tmp_path / 'declared.sqlite'}")
    tables.metadata.create_all(declared)
    migrated = _schema(f"sqlite:///{path / 'catalog.sqlite'}")
    for name, (columns, *rest) in _schema(str(declared.url)).items():
        # SQLite lets the columns of a primary key be null; whether they are declared so is no difference.
        keys = rest[0]
        strip = [(c, t, n) for c, t, n in columns if c not in keys]
        assert strip == [(c, t, n) for c, t, n in migrated[name][0] if c not in keys], name
        assert rest == list(migrated[name][1:]), name


@pytest.mark.parametrize("steps", range(len(migrations.STEPS)))
def test_older_catalogue_is_brought_up_to_date_and_keeps_its_content(path, robot, monkeypatch, steps):
    """The data of a registry that was written when only the first `steps` migrations existed."""
    known = dict(list(migrations.STEPS.items())[:steps])
    with monkeypatch.context() as older:
        older.setattr(migrations, "STEPS", known)
        with Registry.open(path, create=True) as registry:
            if steps:
                fill(registry, robot)
                content = registry.content_hash()
    with Registry.open(path) as registry:
        if steps:
            assert registry.content_hash() == content and len(registry.load("bench")) == 10
        else:
            fill(registry, robot)
        registry.put_index("bench", "graph", {})
        registry.put_simulator({})
    assert verify(path).faults == ()


def test_failed_migration_changes_nothing(registry, monkeypatch):
    content = registry.content_hash()
    broken = migrations.STEPS | {
        "9999_broken": ("CREATE TABLE extra (a TEXT)", "ALTER TABLE nowhere ADD b TEXT")
    }
    monkeypatch.setattr(migrations, "STEPS", broken)
    with pytest.raises(RegistryError):
        Registry.open(registry.path)
    monkeypatch.undo()
    with Registry.open(registry.path) as again:
        assert again.content_hash() == content
    found = (
        sqlite3.connect(registry.path / "catalog.sqlite").execute("SELECT name FROM sqlite_master").fetchall()
    )
    assert ("extra",) not in found


def _newer_catalogue(path: Path) -> None:
    connection = sqlite3.connect(path / "catalog.sqlite")
    with connection:
        connection.execute("INSERT INTO migrations VALUES ('9999_future')")
    connection.close()


def _half_a_catalogue(path: Path) -> None:
    (path / "catalog.sqlite").write_bytes((path / "catalog.sqlite").read_bytes()[:2000])


REFUSED = {
    "missing": (shutil.rmtree, RegistryError, "there is no registry at"),
    "not a registry": (lambda p: (p / "dynreg.json").unlink(), RegistryError, "not a registry"),
    "newer format": (
        lambda p: (p / "dynreg.json").write_text(json.dumps({"format": "dynreg-registry", "version": 99})),
        RegistryError,
        "upgrade dynreg",
    ),
    "other marker": (lambda p: (p / "dynreg.json").write_text("[]"), RegistryError, "not the marker"),
    "newer catalogue": (_newer_catalogue, RegistryError, "9999_future.*upgrade"),
    "lost catalogue": (lambda p: (p / "catalog.sqlite").unlink(), CorruptError, "is lost"),
    "half a catalogue": (_half_a_catalogue, CorruptError, "damaged"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_openings(registry, case):
    damage, kind, message = REFUSED[case]
    path = registry.path
    registry.close()
    damage(path)
    with pytest.raises(kind, match=message) as error:
        Registry.open(path)
    assert type(error.value) is kind


def test_creating(tmp_path):
    deep = tmp_path / "a" / "b"
    Registry.open(deep, create=True).close()
    Registry.open(deep, create=True).close()
    (tmp_path / "file").write_text("")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("")
    for name, message in (
        ("file", "is a file"),
        ("other", "not a registry"),
        ("file/below", "cannot create"),
    ):
        with pytest.raises(RegistryError, match=message):
            Registry.open(tmp_path / name, create=True)
    assert [p.name for p in (tmp_path / "other").iterdir()] == ["thesis.tex"]


def test_what_was_opened_in_vain_is_taken_away(tmp_path, robot):
    new, stored, older = tmp_path / "new", tmp_path / "stored", tmp_path / "older"
    Registry.open(older, create=True).close()
    Registry.open(older, create=True).take_away()
    for folder in (new, stored):
        made = Registry.open(folder, create=True)
        made.put_robot(robot, ROBOT, "arm")
        if folder == stored:
            made.put_recording(make_recording(1), ROBOT)
        made.take_away()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["older", "robot", "stored"]
    with Registry.open(stored) as again:
        assert [info.id for info in again.recordings()] == [make_recording(1).id]


def test_creation_that_was_cut_short_is_finished(tmp_path):
    """After the marker nothing was written; before it only a temporary file."""
    for name in ("dynreg.json", ".dynreg.json.tmp-0123"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / name).write_text('{"format": "dynreg-registry", "version": 1}')
        with Registry.open(folder, create=True) as registry:
            assert registry.populations() == ()


READ_ONLY = """
import os, sys
import safetensors.numpy
from dynreg.registry import Registry
if os.getuid() == 0:
    os.setgid(65534); os.setuid(65534)  # root may write anywhere
from dynreg.errors import RegistryError
with Registry.open(sys.argv[1]) as registry:
    print(len(registry.load("bench")))
    try:
        registry.put_simulator({"a": 1})
    except RegistryError as error:
        print(error)
"""


@pytest.fixture
def open_folder():
    """A folder that every user may enter, unlike pytest's own."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    for item in folder.rglob("*"):
        item.chmod(0o755)
    shutil.rmtree(folder)


def test_registry_without_write_access_can_be_read(registry, open_folder):
    registry.close()
    place = open_folder / "registry"
    shutil.copytree(registry.path, place)
    for item in [*place.rglob("*"), place]:
        item.chmod(0o555 if item.is_dir() else 0o444)
    done = subprocess.run(
        [sys.executable, "-c", READ_ONLY, place], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "10" and "read-only" in done.stdout.splitlines()[1]


def test_importing_the_package_loads_nothing_heavy():
    code = "import sys, dynreg.registry; print({'torch', 'mujoco', 'sklearn', 'pandas'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "set()", done.stdout + done.stderr
