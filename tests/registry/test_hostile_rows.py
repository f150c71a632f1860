"""A stranger's catalogue, whole by its own seals: what its rows say is no more trusted than any other bytes."""

import json
from pathlib import Path

import pytest
from hands import catalogue, sql
from registry_contents import ROBOT, fill, make_robot
from sqlalchemy import select

from dynreg.errors import CorruptError, DynregError
from dynreg.registry import Registry, verify
from dynreg.registry.seal import Seal, write_seals
from dynreg.registry.sharing import shared_at
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
REFUSED = {  # by PostgreSQL itself
    "a text for a number": ODD["a text for a number"],
    "bytes for a name": "UPDATE robots SET name = convert_from('\\xff00', 'UTF8')",
}


def sealed(path: Path, statement: str) -> None:
    """Change a catalogue as its owner can, who knows how it is sealed."""
    sql(path, statement)
    with catalogue(path) as connection:
        rows = {t.name: map(tuple, connection.execute(select(t))) for t in SEALED}
        write_seals(connection, {name: Seal().with_rows(held) for name, held in rows.items()})


@pytest.fixture
def registry(path: Path, tmp_path: Path) -> Path:
    """A registry with a robot and its population."""
    robot = make_robot(tmp_path / "robot")
    (robot / "maps").mkdir()
    (robot / "maps" / "log.toml").write_text("")
    with Registry.open(path, create=True) as made:
        fill(made, robot)
    return path


@pytest.mark.parametrize("title", ODD)
def test_rows_that_dynreg_did_not_write_are_refused_and_found(title: str, registry: Path) -> None:
    if shared_at(registry) is not None and title in REFUSED:
        with pytest.raises(Exception, match="invalid input syntax|invalid byte sequence"):
            sql(registry, REFUSED[title])
        return
    sealed(registry, ODD[title])
    with pytest.raises(CorruptError), Registry.open(registry) as opened:
        opened.robots()
        opened.robot_folder("arm")
        opened.missing_spans("bench")
        opened.load("bench")
    assert verify(registry).faults


def test_a_manifest_that_leads_out_of_the_registry_removes_nothing(registry: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    manifest = {
        "maps/../../../../victim": "ab" * 32
    }  # no hash of a robot covers its maps, so they may be replaced
    with catalogue(registry) as connection:
        manifest |= json.loads(connection.exec_driver_sql("SELECT manifest FROM robots").scalar_one())
    sealed(registry, f"UPDATE robots SET manifest = '{json.dumps(manifest)}'")
    with pytest.raises(DynregError), Registry.open(registry) as opened:
        opened.put_robot(tmp_path / "robot", ROBOT, "arm")
    assert victim.read_text() == "precious"


def test_a_marker_of_an_endless_version_is_none(registry: Path) -> None:
    (registry / "dynreg.json").write_text('{"format": "dynreg-registry", "version": 1e999}')
    with pytest.raises(CorruptError, match="the marker .* is missing or damaged"):
        Registry.open(registry)
