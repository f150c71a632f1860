"""A stranger's catalogue, whole by its own seals: what its rows say is no more trusted than any other bytes."""

import json
import sqlite3
from pathlib import Path

import pytest
from registry_contents import ROBOT, fill, make_robot
from sqlalchemy import create_engine, select

from dynreg.errors import CorruptError, DynregError
from dynreg.registry import Registry, verify
from dynreg.registry.seal import Seal, write_seals
from dynreg.registry.tables import SEALED

ODD = {
    "a text for a number": "UPDATE shards SET stop = 'many'",
    "a number that no count is": "UPDATE populations SET size = -1",
    "a manifest that is a number": "UPDATE robots SET manifest = '1'",
    "a manifest that is no JSON": "UPDATE robots SET manifest = 'x'",
    "a manifest that leads out": """UPDATE robots SET manifest = '{"../../victim": "ab"}'""",
    "a layout that is a list": "UPDATE populations SET layout = '[]'",
    "more entries than memory has room for": f"UPDATE populations SET size = {2**40}",
    "bytes for a name": "UPDATE robots SET name = x'ff00'",
}


def sealed(folder: Path, statement: str) -> None:
    """Change a catalogue as its owner can, who knows how it is sealed."""
    held = sqlite3.connect(folder / "catalog.sqlite")
    held.execute(statement)
    held.commit()
    held.close()
    engine = create_engine(f"sqlite:///{folder / 'catalog.sqlite'}")
    with engine.begin() as connection:
        rows = {t.name: map(tuple, connection.execute(select(t))) for t in SEALED}
        write_seals(connection, {name: Seal().with_rows(held) for name, held in rows.items()})
    engine.dispose()


@pytest.fixture
def registry(tmp_path: Path) -> Path:
    """A registry with a robot and its population."""
    robot = make_robot(tmp_path / "robot")
    (robot / "maps").mkdir()
    (robot / "maps" / "log.toml").write_text("")
    with Registry.open(tmp_path / "registry", create=True) as made:
        fill(made, robot)
    return tmp_path / "registry"


@pytest.mark.parametrize("title", ODD)
def test_rows_that_dynreg_did_not_write_are_refused_and_found(title: str, registry: Path) -> None:
    sealed(registry, ODD[title])
    with pytest.raises(CorruptError), Registry.open(registry) as opened:
        opened.robots()
        opened.missing_spans("bench")
    assert verify(registry).faults


def test_a_manifest_that_leads_out_of_the_registry_removes_nothing(registry: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    manifest = {
        "maps/../../../../victim": "ab" * 32
    }  # no hash of a robot covers its maps, so they may be replaced
    old = sqlite3.connect(registry / "catalog.sqlite")
    manifest |= json.loads(old.execute("SELECT manifest FROM robots").fetchone()[0])
    old.close()
    sealed(registry, f"UPDATE robots SET manifest = '{json.dumps(manifest)}'")
    with pytest.raises(DynregError), Registry.open(registry) as opened:
        opened.put_robot(tmp_path / "robot", ROBOT, "arm")
    assert victim.read_text() == "precious"


def test_a_marker_of_an_endless_version_is_none(registry: Path) -> None:
    (registry / "dynreg.json").write_text('{"format": "dynreg-registry", "version": 1e999}')
    with pytest.raises(CorruptError, match="the marker .* is missing or damaged"):
        Registry.open(registry)
