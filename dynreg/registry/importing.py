"""Another registry taken into this one, by content: what is here already stays as it is."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import select

import dynreg.registry.tables as tables
from dynreg.errors import DiffersError, DynregError, LimitError, NoMatchError, NoPlaceError, RegistryError
from dynreg.registry.entries import put_shard
from dynreg.registry.exporting import copy_indexes, copy_plan, copy_thing, is_there
from dynreg.registry.loading import load_shard
from dynreg.registry.opening import open_directory
from dynreg.registry.populations import held_spans
from dynreg.registry.recordings import add_name, recordings_of_names
from dynreg.registry.references import ID_COLUMNS  # what others need comes first
from dynreg.registry.registry import Registry
from dynreg.registry.renewing import renew

Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Imported:
    """What an import brought.

    added, known : {kind: how many} of the other registry's things that are new here, and that were here before.
    left_out : what was not taken, and why. damaged : how many of these things are damaged there.
    """

    added: dict[str, int]
    known: dict[str, int]
    left_out: tuple[str, ...]
    damaged: int


@dataclass
class _LeftOut:
    """What is not taken: a line for each thing, and how many of them are damaged."""

    lines: list[str] = field(default_factory=list)
    damaged: int = 0

    def note(self, source: Registry, kind: str, identity: str, error: Exception, also: str = "") -> None:
        """Write down a thing; one that differs, is too large or was removed meanwhile is not damaged."""
        gone = isinstance(error, NoMatchError) and not is_there(source, kind, identity)
        self.damaged += not (gone or isinstance(error, DiffersError | LimitError))
        if isinstance(error, LimitError):  # what to do about it is not what a damaged source asks for
            why = str(error)
        else:
            why = error.problem if isinstance(error, DynregError) else f"{type(error).__name__}: {error}"
        self.lines.append(f"{kind} {identity[:12]}: {why}{also}")


def open_source(path: Path) -> Registry:
    """Open a registry to take things from: nothing in its folder changes.

    What is of an older form there is written in the present one to a temporary folder. Raises as `Registry.open`.
    """
    directory = open_directory(path, create=False, aside=True)
    renew(directory, aside=True)
    return Registry(directory)


def take_in(registry: Registry, source: Registry, report: Report = lambda *_: None) -> Imported:
    """Put everything that `source` holds into `registry`; ids stay as they are.

    What is here already stays as it is: a recording keeps its robot and its place in the order. Of a population with
    entries here, those that are missing are added; a recording gets the names that are free here. New recordings and
    results follow those that are here, in their order. What cannot be read in the source, or is another one here under
    the same id, is left out. Ids are computed anew from what is read.

    Raises RegistryError where the registry may not be written or has no room; what was taken until then stays.
    """
    registry.check_writable()
    if source.path.resolve() == registry.path.resolve():
        raise RegistryError(
            f"{str(source.path)!r} is the registry itself",
            expected="another registry",
            do="give the folder of an exported one",
        )
    theirs, before = _ids(source), _ids(registry)
    things = [(kind, identity) for kind in ID_COLUMNS if kind != "entry" for identity in theirs[kind]]
    left_out = _LeftOut(list(_taken_names(registry, source)))
    for number, (kind, identity) in enumerate(things):
        report("import", number, len(things))
        try:
            _TAKE.get(kind, _take)(registry, source, kind, identity, left_out)
        except (NoPlaceError, MemoryError):
            raise
        except Exception as error:  # whatever odd rows and documents of a stranger lead to
            left_out.note(source, kind, identity, error)
    report("import", len(things), len(things))
    now = _ids(registry)
    added = {kind: len(set(theirs[kind]) & set(now[kind]) - set(before[kind])) for kind in ID_COLUMNS}
    known = {kind: len(set(theirs[kind]) & set(before[kind])) for kind in ID_COLUMNS}
    return Imported(added, known, tuple(left_out.lines), left_out.damaged)


def _take(registry: Registry, source: Registry, kind: str, identity: str, left_out: _LeftOut) -> None:
    copy_thing(source, registry, kind, identity)


def _take_recording(
    registry: Registry, source: Registry, kind: str, identity: str, left_out: _LeftOut
) -> None:
    """A recording; of one that is here only the names that are free."""
    if not is_there(registry, kind, identity):
        return copy_thing(source, registry, kind, identity)
    info = source.recording_info(identity)
    for name, robot in zip(info.names, info.robots, strict=True):
        if registry.name_holder(name) is None:
            copy_thing(source, registry, "robot", robot)
            add_name(registry.directory, identity, name, robot)


def _take_population(
    registry: Registry, source: Registry, kind: str, identity: str, left_out: _LeftOut
) -> None:
    """A population with the entries that are missing here, those of each shard that can be read."""
    theirs, ours = _entries(source, identity), _entries(registry, identity)
    problem: Exception | None = None
    try:
        _check_same_entries(identity, ours, theirs)
        copy_plan(source, registry, identity)
        with source.directory.catalog.read() as connection:
            spans = held_spans(connection, identity)
    except (NoPlaceError, MemoryError):
        raise
    except Exception as error:
        problem, spans = error, []
    for start, stop in spans:
        if all(n in theirs and ours.get(n) == theirs[n] for n in range(start, stop)):
            continue
        try:
            put_shard(registry.directory, identity, start, load_shard(source.directory, identity, start))
        except (NoPlaceError, MemoryError):
            raise
        except Exception as error:
            problem = problem or error
    now = _entries(registry, identity)
    if problem is not None:
        missing = len(set(theirs.values()) - set(now.values()))
        also = f"; {missing} of its {len(theirs)} entries are missing here" if missing else ""
        left_out.note(source, kind, identity, problem, also)
    elif now != ours:
        copy_indexes(source, registry, identity)


_TAKE = {"population": _take_population, "recording": _take_recording}


def _entries(registry: Registry, population_id: str) -> dict[int, str]:
    """{number: id} of the entries of a population."""
    table = tables.entries
    query = select(table.c.number, table.c.id).where(table.c.population_id == population_id)
    with registry.directory.catalog.read() as connection:
        return dict(connection.execute(query).all())


def _check_same_entries(population_id: str, ours: Mapping[int, str], theirs: Mapping[int, str]) -> None:
    """DiffersError where a number stands for one entry here and for another one there: no entry is added then."""
    changed = sorted(n for n, identity in ours.items() if theirs.get(n, identity) != identity)
    if changed:
        raise DiffersError(
            f"entry {changed[0]} of population {population_id[:12]} is another one than is stored",
            expected=f"entry {ours[changed[0]][:12]} under this number, not {theirs[changed[0]][:12]}",
            do="keep such populations in registries of their own",
        )


def _ids(registry: Registry) -> dict[str, list[str]]:
    """Ids by kind; those that have an order in theirs."""
    with registry.directory.catalog.read() as connection:
        return {
            kind: list(connection.execute(select(c).order_by(c.table.c.get("ordinal", c))).scalars())
            for kind, c in ID_COLUMNS.items()
        }


def _taken_names(registry: Registry, source: Registry) -> Iterator[str]:
    """Names that mean one recording here and another there."""
    here = recordings_of_names(registry.directory)
    for name, identity in recordings_of_names(source.directory).items():
        if here.get(name, identity) != identity:
            yield f"the name {name!r} of recording {identity[:12]}: here it means recording {here[name][:12]}"
