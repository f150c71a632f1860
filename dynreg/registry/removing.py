"""Things taken out of a registry, with what cannot be used without them.

One transaction takes out all of their rows, and its page of the ledger says which files went with them. The files are
removed after it: where that is cut short, nothing knows them any more, and `gc` and a repair go on with it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, Table, select

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, UsageError
from dynreg.registry.exporting import simulators_in
from dynreg.registry.files import INDEX, ROBOTS
from dynreg.registry.infos import RobotInfo
from dynreg.registry.registry import Registry
from dynreg.registry.versions import numbered
from dynreg.registry.writing import Writing

Thing = tuple[str, str]  # kind and id
Fits = Callable[[str, str], bool]  # says for a recording's id and a robot's hash whether they go together
_HOMES = {
    "robot": tables.robots,
    "population": tables.populations,
    "recording": tables.recordings,
    "measured": tables.measured,
    "simulator": tables.simulators,
    "result": tables.results,
}
KINDS = tuple(_HOMES)


@dataclass(frozen=True)
class Removal:
    """What goes, and what changes with it.

    Attributes
    ----------
    things : why each thing goes, by kind and id: "" where it was asked for, else the thing that it needs.
    moved : the version with which a recording is used from now on, by its id, where its own version goes.
    named : the version that a name of a recording asks it with from now on, where its own goes; None where no other
        fits, and the name then means the recording's own.
    files : paths of the files that go, in the registry; a folder's ends in "/".
    size : their bytes.
    """

    things: Mapping[Thing, str]
    moved: Mapping[str, RobotInfo] = field(default_factory=dict)
    named: Mapping[str, RobotInfo | None] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    size: int = 0


@dataclass(frozen=True)
class _Known:
    """What a removal was planned by: if it changes meanwhile, the removal is planned anew."""

    robots: tuple[RobotInfo, ...]
    rows: Mapping[str, tuple[tuple[Any, ...], ...]]

    @classmethod
    def of(cls, connection: Connection) -> "_Known":
        """What the catalogue holds now."""
        columns = {
            "population": ("id", "robot_hash"),
            "recording": ("id", "robot_hash"),
            "measured": ("id", "population_id", "recording_id"),
            "simulator": ("id",),
            "result": ("id", "recording_id"),
        }
        rows = {
            kind: tuple(sorted(map(tuple, connection.execute(select(*(_HOMES[kind].c[n] for n in names))))))
            for kind, names in columns.items()
        }
        told, called = tables.robots_of_names, tables.recording_names
        own = select(told.c.name, called.c.recording_id, told.c.robot_hash).join(called)
        rows["name"] = tuple(sorted(map(tuple, connection.execute(own))))
        return cls(numbered(connection), rows)


def _any(recording: str, robot: str) -> bool:
    return True


def removal(registry: Registry, refs: Sequence[str], fits: Fits = _any) -> Removal:
    """What `remove` would take out; nothing is changed.

    Raises NoMatchError for a ref that fits nothing or several things, UsageError for an entry, which is a part of its
    population, and for no ref at all.
    """
    with registry.directory.catalog.read() as connection:
        known = _Known.of(connection)
    return _planned(registry, _wanted(registry, refs), known, fits)


def remove(registry: Registry, refs: Sequence[str], fits: Fits = _any) -> Removal:
    """Take things out of the registry, with what cannot be used without them; returns what went.

    A recording stays where its robot's version goes and another version is left that it `fits`; it then belongs to the
    newest of those. Raises as `removal`, RegistryError where the registry may not be written.
    """
    registry.check_writable()
    wanted = _wanted(registry, refs)
    while True:
        with registry.directory.catalog.read() as connection:
            known = _Known.of(connection)
        plan = _planned(registry, wanted, known, fits)
        with registry.directory.catalog.write() as writing:
            if _Known.of(writing.connection) == known:  # else somebody put more meanwhile
                _take_out(writing, plan)
                break
    with registry.directory.catalog.write() as writing:  # nobody registers any of these files meanwhile
        registry.directory.take_time(writing.connection)
        registry.directory.remove(_unnamed(writing.connection, plan.files))
    return plan


def _wanted(registry: Registry, refs: Sequence[str]) -> tuple[Thing, ...]:
    if not refs:
        raise UsageError("nothing to remove", expected="an id or a name", do="see `dynreg list`")
    found = [registry.resolve(ref) for ref in refs]
    for ref, (kind, identity) in zip(refs, found, strict=True):
        if kind == "entry":
            population = registry.load_entry(identity).population_id
            raise UsageError(
                f"{ref!r} is an entry, which is stored with others of its population",
                expected=f"one of the kinds {', '.join(KINDS)}",
                do=f"remove the population with `dynreg rm {population[:12]}`, or leave the entry",
            )
    return tuple(dict.fromkeys(found))


def _planned(registry: Registry, wanted: Sequence[Thing], known: _Known, fits: Fits) -> Removal:
    instead = _instead(known, wanted, fits)
    needing = _needing(registry, known, instead)
    things: dict[Thing, str] = dict.fromkeys(wanted, "")
    queue = list(wanted)
    while queue:
        one = queue.pop(0)
        for other in needing.get(one, ()):
            if other not in things:
                things[other] = f"{one[0]} {one[1][:12]}"
                queue.append(other)
    moved = {identity: info for identity, info in instead.items() if ("recording", identity) not in things}
    named = {
        name: _newest_left(known, wanted, fits, recording, robot)
        for name, recording, robot in known.rows["name"]
        if ("robot", robot) in wanted and ("recording", recording) not in things
    }
    with registry.directory.catalog.read() as connection:
        files = tuple(_files_of(registry, connection, things))
    return Removal(things, moved, named, files, sum(map(registry.directory.size, files)))


def _instead(known: _Known, wanted: Sequence[Thing], fits: Fits) -> dict[str, RobotInfo]:
    """Of recordings whose robot's version goes: the newest version that is left and that each one fits, if any.

    Else it is that of another robot, under which the recording has a name.
    """
    found = {}
    for identity, robot in known.rows["recording"]:
        if ("robot", robot) in wanted:
            named = [other for _, recording, other in known.rows["name"] if recording == identity]
            others = (_newest_left(known, wanted, fits, identity, one) for one in (robot, *named))
            info = next((info for info in others if info is not None), None)
            if info is not None:
                found[identity] = info
    return found


def _newest_left(
    known: _Known, wanted: Sequence[Thing], fits: Fits, recording: str, robot: str
) -> RobotInfo | None:
    """The newest version of a robot (the hash of any version) that is left and that a recording fits."""
    name = next(info.name for info in known.robots if info.hash == robot)
    left = (i for i in reversed(known.robots) if i.name == name and ("robot", i.hash) not in wanted)
    return next((info for info in left if fits(recording, info.hash)), None)


def _needing(registry: Registry, known: _Known, instead: Mapping[str, RobotInfo]) -> dict[Thing, list[Thing]]:
    """What cannot be used without each thing."""
    needing: dict[Thing, list[Thing]] = {}

    def note(thing: Thing, other: Thing) -> None:
        needing.setdefault(thing, []).append(other)

    for identity, robot in known.rows["population"]:
        note(("robot", robot), ("population", identity))
    for identity, robot in known.rows["recording"]:
        if identity not in instead:
            note(("robot", robot), ("recording", identity))
    for identity, population, recording in known.rows["measured"]:
        note(("population", population), ("measured", identity))
        note(("recording", recording), ("measured", identity))
    for (identity,) in known.rows["simulator"]:
        note(("robot", _told(registry.simulator, identity).get("robot", "")), ("simulator", identity))
    simulators = {identity for (identity,) in known.rows["simulator"]}
    for identity, recording in known.rows["result"]:
        if recording:
            note(("recording", recording), ("result", identity))
        document = _told(lambda ref: registry.result(ref).document, identity)
        note(("robot", str(document.get("robot_hash", ""))), ("result", identity))
        note(("population", str(document.get("population", ""))), ("result", identity))
        # A calibration stays without its stored gait: it has the genes, and trials on a robot cannot be had again.
        for named in sorted(simulators_in(document) & simulators):
            note(("simulator", named), ("result", identity))
    return needing


def _told(read: Any, identity: str) -> Mapping[str, Any]:
    """A stored document; nothing of one that is damaged, or that is hidden from verbs."""
    try:
        return read(identity)
    except CorruptError:
        return {}


def _rows(
    connection: Connection, table: Table, column: str, ids: Iterable[str]
) -> Iterator[Mapping[str, Any]]:
    for identity in ids:
        yield from connection.execute(select(table).where(table.c[column] == identity)).mappings()


def _of(things: Iterable[Thing], kind: str) -> list[str]:
    return [identity for one, identity in things if one == kind]


def _files_of(registry: Registry, connection: Connection, things: Iterable[Thing]) -> Iterator[str]:
    """The files of things, by their paths in the registry; of a robot its folder."""
    for kind in ("population", "recording", "measured", "simulator", "result"):
        for row in _rows(connection, _HOMES[kind], "id", _of(things, kind)):
            yield row["path"]
    for row in _rows(connection, tables.shards, "population_id", _of(things, "population")):
        yield from (row["states_path"], row["arrays_path"])
    for identity in _of(things, "population"):
        for name in registry.directory.names(INDEX):
            if name.startswith(f"{INDEX}/{identity[:16]}-"):
                yield name
    for identity in _of(things, "robot"):
        yield f"{ROBOTS}/{identity}/"


def _take_out(writing: Writing, plan: Removal) -> None:
    """Take out the rows of things, those first that refer to others."""
    connection = writing.connection
    for row in list(_rows(connection, tables.recordings, "id", plan.moved)):
        writing.put(tables.recordings, {**row, "robot_hash": plan.moved[row["id"]].hash})
    own = {name: info for name, info in plan.named.items() if info is not None}
    writing.put(tables.robots_of_names, *({"name": n, "robot_hash": info.hash} for n, info in own.items()))
    populations, recordings, robots = (
        _of(plan.things, kind) for kind in ("population", "recording", "robot")
    )
    names = _keys(connection, tables.recording_names, "recording_id", recordings)
    gone = {
        tables.robots_of_names: [*names, *((name,) for name in plan.named if name not in own)],
        tables.latest_names: [(identity,) for identity in recordings],
        tables.recording_names: names,
        tables.entries: _keys(connection, tables.entries, "population_id", populations),
        tables.shards: _keys(connection, tables.shards, "population_id", populations),
        tables.robot_versions: [(identity,) for identity in robots],
    }
    gone |= {table: [(i,) for i in _of(plan.things, kind)] for kind, table in _HOMES.items()}
    for table in reversed(tables.HELD):
        if table is not tables.files:
            writing.remove(table, *gone[table])
    writing.remove(tables.files, *((path,) for path in plan.files if not _is_used(connection, path)))


def _keys(connection: Connection, table: Table, column: str, ids: Sequence[str]) -> list[tables.Key]:
    keys = [key.name for key in table.primary_key]
    return [tuple(row[name] for name in keys) for row in _rows(connection, table, column, ids)]


def _is_used(connection: Connection, path: str) -> bool:
    """Whether a row that is left refers to a file."""
    columns = [c for t in tables.HELD for c in t.c if c.references(tables.files.c.path)]
    return any(connection.execute(select(c).where(c == path).limit(1)).first() for c in columns)


def _unnamed(connection: Connection, files: Iterable[str]) -> list[str]:
    """Those of these files that no row names: somebody may have put one again meanwhile."""
    robots = set(connection.execute(select(tables.robots.c.hash)).scalars())
    named = set(connection.execute(select(tables.files.c.path)).scalars())
    return [f for f in files if f not in named and not (f.endswith("/") and f.split("/")[1] in robots)]
