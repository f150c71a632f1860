"""What is done to a registry while power is lost: each step one call of its door; and what can be read afterwards."""

import hashlib
import shutil
import sqlite3
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from registry_contents import (
    ROBOT,
    fill,
    make_population,
    make_recording,
    make_robot,
    make_shard,
)

import dynreg.registry.repairing as repairing
from dynreg.errors import NoMatchError
from dynreg.registry import Registry, collect, export, remove, verify

REGISTRY = "new/place/registry"  # parents are made along with it
EXPORT = "exported"
OLD = {name: Path(__file__).parents[1] / f"{name}.zip" for name in ("format_1", "form_2")}
Sight = Mapping[str, Any]


@dataclass(frozen=True)
class Step:
    """A step, given the folder that is watched and one beside it with what is put in; it may be done twice.

    `heals`: what is there is damaged before the step, and may be until it was done whole.
    """

    name: str
    do: Callable[[Path, Path], None]
    heals: bool = False


@dataclass(frozen=True)
class Scenario:
    """Steps that follow each other, after a beginning that nobody watches."""

    name: str
    begin: Callable[[Path, Path], None]
    steps: tuple[Step, ...]


def look(root: Path) -> dict[str, Any]:
    """All that can be read of the registry and of its export, None where there is none."""
    places = {"registry": root / REGISTRY, "export": root / EXPORT}
    return {name: _look(place) if place.is_dir() else None for name, place in places.items()}


def _look(place: Path) -> dict[str, Any]:
    with Registry.open(place) as registry:
        populations = registry.populations()
        held = [registry.load(p.id) for p in populations if registry.count(p.id)]
        return {
            "robots": {h: _folder(registry.robot_folder(h), maps=False) for h in registry.robots()},
            "maps": {h: _folder(registry.robot_folder(h), maps=True) for h in registry.robots()},
            "populations": [(p.id, p.name, p.size, p.spec, _digest(p.arrays)) for p in populations],
            "entries": [(a.ids, _digest({"values": a.values, "states": a.states} | a.weights)) for a in held],
            "recordings": [(i.id, i.robot_hash, i.names) for i in registry.recordings()],
            "read": [registry.recording(i.id).id for i in registry.recordings()],
            "results": [registry.result(i) for i in registry.ids("result")],
            "simulators": [registry.simulator(i) for i in registry.ids("simulator")],
            "indexes": [_digest(registry.index(p.id, "graph") or {}) for p in populations],
            "cached": registry.cached("thresholds", {"of": "a test"}),
        }


def _folder(folder: Path, maps: bool) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file() and ".tmp-" not in path.name)
    named = {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
    return {name: data for name, data in named.items() if name.startswith("maps/") == maps}


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    return hashlib.sha256(
        b"".join(name.encode() + arrays[name].tobytes() for name in sorted(arrays))
    ).hexdigest()


def step(name: str, act: Callable[[Registry, Path], Any]) -> Step:
    """A step on the registry, opened for it."""

    def do(root: Path, aside: Path) -> None:
        with Registry.open(root / REGISTRY, create=True) as registry:
            act(registry, aside)

    return Step(name, do)


def _claimed_shard(registry: Registry, aside: Path) -> None:
    with registry.claim("bench", 0):
        registry.put_shard("bench", 0, make_shard(0, 4))


def _rm(registry: Registry, ref: str) -> None:
    with suppress(NoMatchError):  # a step may be done twice
        remove(registry, [ref])


def _export(root: Path, aside: Path) -> None:
    if not (root / EXPORT).exists():
        with Registry.open(root / REGISTRY) as registry:
            export(registry, (registry.latest("neighbours").id,), root / EXPORT)


def _repair(root: Path, aside: Path) -> None:
    with mock.patch.object(
        repairing, "_SPARE", 4096
    ):  # the room that it asks for, which would be a part of each state
        verify(root / REGISTRY, repair=True)


LIFE = Scenario(
    "life",
    lambda root, aside: _robots(aside),
    (
        step("create", lambda registry, aside: None),
        step("robot", lambda registry, aside: registry.put_robot(aside / "robot", ROBOT, "arm")),
        step("population", lambda registry, aside: registry.put_population(make_population(8))),
        step("shard, claimed", _claimed_shard),
        step("shard", lambda registry, aside: registry.put_shard("bench", 4, make_shard(4, 8))),
        step("recording", lambda registry, aside: registry.put_recording(make_recording(1), ROBOT, "first run")),
        step("second name", lambda registry, aside: registry.put_recording(make_recording(1), ROBOT, "again")),
        step("recording of no name", lambda registry, aside: registry.put_recording(make_recording(2), ROBOT)),
        step("result", lambda registry, aside: registry.put_result("neighbours", "first run", {"k": 5})),
        step("simulator", lambda registry, aside: registry.put_simulator({"robot": ROBOT, "values": {"m": 1.5}})),
        step("index", lambda registry, aside: registry.put_index("bench", "graph", {"near": np.arange(8)})),
        step("index again", lambda registry, aside: registry.put_index("bench", "graph", {"near": np.ones(8)})),
        step("cache", lambda registry, aside: registry.cache("thresholds", {"of": "a test"}, {"value": 3.0})),
        step("cache again", lambda registry, aside: registry.cache("thresholds", {"of": "a test"}, {"value": 4.0})),
        step("growth", lambda registry, aside: registry.put_population(make_population(10))),
        step("shard of the growth", lambda registry, aside: registry.put_shard("bench", 8, make_shard(8, 10))),
        step("other maps", lambda registry, aside: registry.put_robot(aside / "other maps", ROBOT, "arm")),
        step("open", lambda registry, aside: None),
        Step("repair of what is sound", _repair),
        Step("export", _export),
    ),
)  # fmt: skip


def _robots(aside: Path) -> None:
    make_robot(aside / "robot")
    (aside / "robot" / "maps").mkdir()
    for name in ("old.toml", "changed.toml"):
        (aside / "robot" / "maps" / name).write_text("[columns]\n")
    shutil.copytree(aside / "robot", aside / "other maps")
    (aside / "other maps" / "maps" / "old.toml").rename(aside / "other maps" / "maps" / "new.toml")
    (aside / "other maps" / "maps" / "changed.toml").write_text("[episodes]\n")


def _filled(root: Path, aside: Path) -> Path:
    place = root / REGISTRY
    with Registry.open(place, create=True) as registry:
        fill(registry, make_robot(aside / "robot"), 8)
        registry.put_recording(make_recording(1), ROBOT, "first run")
        registry.put_result("neighbours", "first run", {"k": 5})
        registry.put_simulator({"robot": ROBOT, "values": {"m": 1.5}})
    return place


def _unpacked(name: str) -> Callable[[Path, Path], None]:
    return lambda root, aside: zipfile.ZipFile(OLD[name]).extractall(root / REGISTRY)


SHORT = Scenario("short", LIFE.begin, LIFE.steps[:5])


def _damaged(damage: Callable[[Path], None]) -> Callable[[Path, Path], None]:
    def begin(root: Path, aside: Path) -> None:
        damage(_filled(root, aside))

    return begin


def _no_catalogue(place: Path) -> None:
    (place / "catalog.sqlite").unlink()


def _torn_catalogue(place: Path) -> None:
    """The beginning of a catalogue, with the log of SQLite beside it that a killed process leaves."""
    catalog, log = place / "catalog.sqlite", place / "catalog.sqlite-wal"
    with closing(sqlite3.connect(catalog)) as connection, connection:
        connection.execute("UPDATE recording_names SET name = 'changed'")
        connection.commit()
        left = log.read_bytes()
    catalog.write_bytes(catalog.read_bytes()[:3000])
    log.write_bytes(left)


def _bad_shard_and_stray(place: Path) -> None:
    shard = sorted((place / "shards").glob("*.parquet"))[0]
    shard.write_bytes(b"\0" + shard.read_bytes()[1:])
    (place / "results" / "notes.txt").write_text("no result")


REMOVALS = (
    step("rm of a recording", lambda registry, aside: _rm(registry, "first run")),
    step("rm of a population", lambda registry, aside: _rm(registry, "bench")),
    step("gc", lambda registry, aside: collect(registry)),
)
REPAIR = (Step("repair", _repair, heals=True), Step("repair again", _repair))
SCENARIOS = {
    s.name: s
    for s in (
        LIFE,
        Scenario("removal", _damaged(lambda place: None), REMOVALS),
        Scenario("migration", _unpacked("format_1"), (step("open", lambda registry, aside: None),)),
        Scenario("renewal", _unpacked("form_2"), (step("open", lambda registry, aside: None),)),
        Scenario("lost catalogue", _damaged(_no_catalogue), REPAIR),
        Scenario("torn catalogue", _damaged(_torn_catalogue), REPAIR),
        Scenario("bad shard", _damaged(_bad_shard_and_stray), REPAIR),
    )
}
