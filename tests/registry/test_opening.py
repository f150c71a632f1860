"""Opening: any older registry works, anything else is an error that says what to do."""

import json
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from registry_contents import ROBOT, make_recording, make_shard
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


LATER = {  # what the steps after the first brought to format 1
    "0003_indexes": ("indexes",),
    "0002_simulators_and_results": ("simulators", "results"),
}


@pytest.mark.parametrize("without", range(len(LATER) + 1))
def test_registry_of_format_1_is_brought_up_to_date_and_keeps_its_content(path, without):
    """The fixture was filled by the last version that wrote format 1, with what `conftest.filled` holds and more."""
    shutil.unpack_archive(Path(__file__).with_name("format_1.zip"), path)
    connection = sqlite3.connect(path / "catalog.sqlite")
    with connection:
        for step, names in list(LATER.items())[:without]:
            for name in names:
                if name in ("simulators", "results"):
                    connection.execute(f"DELETE FROM files WHERE path LIKE '{name}/%'")
                    shutil.rmtree(path / name)
                connection.execute(f"DROP TABLE {name}")
            connection.execute("DELETE FROM migrations WHERE name = ?", (step,))
    connection.close()
    for _ in range(2):
        with Registry.open(path) as registry:
            assert (
                registry.content_hash() == "1fb48489fce0b83fb5e23fc7804c3a676c917d0f54eccd1df831282ba1b99c46"
            )
            np.testing.assert_array_equal(registry.load("bench").states, make_shard(0, 10).states)
            assert [info.names for info in registry.recordings()] == [("second run",), ("again", "first run")]
            assert registry.index("bench", "landmarks") is not None
            if without < 2:
                assert registry.latest().document == {"k": 5} and len(registry.ids("result")) == 2
        assert verify(path).faults == () and verify(path).leftovers == ()
    assert json.loads((path / "dynreg.json").read_text())["version"] == 2
    (path / "catalog.sqlite").unlink()
    verify(path, repair=True)
    with Registry.open(path) as registry:
        assert [info.names for info in registry.recordings()] == [("second run",), ("again", "first run")]


def test_names_of_a_registry_before_their_robots_were_kept_have_that_of_the_last_ingestion(
    path, filled, robot
):
    shutil.copytree(filled, path)
    connection = sqlite3.connect(path / "catalog.sqlite")
    with connection:
        connection.execute("DROP TABLE robots_of_names")
        connection.execute("DELETE FROM seals WHERE name = 'robots_of_names'")
        connection.execute("DELETE FROM migrations WHERE name = '0006_robots_of_names'")
    connection.close()
    with Registry.open(path) as registry:
        assert registry.recording_info("first run").robots == (ROBOT,)
        registry.put_robot(robot, "ef" * 32, "leg")
        registry.put_recording(make_recording(1), "ef" * 32, "as a leg")
        info = registry.recording_info("first run")
        assert (info.robot_as("first run"), info.robot_as("as a leg")) == (ROBOT, "ef" * 32)
    assert verify(path).faults == () and verify(path).leftovers == ()


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


def _leave_one_file(path: Path) -> None:
    shutil.rmtree(path)
    path.mkdir()
    (path / "thesis.tex").write_text("")


REFUSED = {
    "missing": (shutil.rmtree, RegistryError, "there is no registry at"),
    "lost marker": (lambda p: (p / "dynreg.json").unlink(), CorruptError, "marker .* verify --repair"),
    "not a registry": (_leave_one_file, RegistryError, "not a registry"),
    "newer format": (
        lambda p: (p / "dynreg.json").write_text(json.dumps({"format": "dynreg-registry", "version": 99})),
        RegistryError,
        "upgrade dynreg",
    ),
    "other marker": (
        lambda p: (p / "dynreg.json").write_text("[]"),
        CorruptError,
        "marker .* verify --repair",
    ),
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
        made.cache("robot_check", {"robot": ROBOT}, {"errors": ["no"]})
        if folder == stored:
            made.put_recording(make_recording(1), ROBOT)
        made.take_away()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["older", "robot", "stored"]
    with Registry.open(stored) as again:
        assert [info.id for info in again.recordings()] == [make_recording(1).id]


def test_what_a_command_goes_on_from_is_not_taken_away(tmp_path, robot):
    made = Registry.open(tmp_path / "new", create=True)
    made.put_robot(robot, ROBOT, "arm")
    made.cache("trial", {"seed": 1}, {"found": 2})
    made.take_away()
    with Registry.open(tmp_path / "new") as again:
        assert again.cached("trial", {"seed": 1}) == {"found": 2}


def test_a_registry_that_another_has_open_is_not_taken_away(tmp_path, robot):
    made = Registry.open(tmp_path / "new", create=True)
    with Registry.open(tmp_path / "new", create=True) as other:
        made.take_away()
        other.put_robot(robot, ROBOT, "arm")
        other.put_recording(make_recording(1), ROBOT)
    with Registry.open(tmp_path / "new") as again:
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
    simulator = registry.put_simulator({"a": 1})
    print(registry.simulator(simulator), registry.read_only)
    try:
        registry.check_writable()
    except RegistryError as error:
        print(error)
with Registry.open(sys.argv[1]) as registry:
    print(len(registry.ids("simulator")))
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
    read, put, refused, kept = done.stdout.splitlines()
    assert (read, put, kept) == ("10", "{'a': 1} True", "1") and "read-only" in refused


def test_importing_the_package_loads_nothing_heavy():
    code = "import sys, dynreg.registry; print({'torch', 'mujoco', 'sklearn', 'pandas'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "set()", done.stdout + done.stderr
