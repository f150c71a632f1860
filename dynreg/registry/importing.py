"""Another registry taken into this one, by content: what is here already stays as it is."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from sqlalchemy import select

import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, DiffersError, RegistryError
from dynreg.registry.exporting import copy_thing
from dynreg.registry.recordings import recordings_of_names
from dynreg.registry.registry import Registry

Report = Callable[[str, int, int], None]
# What others need comes first.
_IDS = {
    "robot": tables.robots.c.hash,
    "population": tables.populations.c.id,
    "entry": tables.entries.c.id,
    "recording": tables.recordings.c.id,
    "measured": tables.measured.c.id,
    "simulator": tables.simulators.c.id,
    "result": tables.results_of_verbs.c.id,
}


@dataclass(frozen=True)
class Imported:
    """What an import brought.

    added, known : {kind: how many} of the other registry's things that are new here, and that were here before.
    left_out : what was not taken, and why.
    """

    added: dict[str, int]
    known: dict[str, int]
    left_out: tuple[str, ...]


def take_in(registry: Registry, source: Registry, report: Report = lambda *_: None) -> Imported:
    """Put everything that `source` holds into `registry`; ids stay as they are.

    Of a population with entries here, those that are missing are added. Recordings and results follow those that are
    here, in their order. A name that means another recording here stays with that one. What is damaged in the source,
    or is another one here under the same id, is left out. Ids are computed anew from what is read.

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
    things = [(kind, identity) for kind in _IDS if kind != "entry" for identity in theirs[kind]]
    left_out = list(_taken_names(registry, source))
    for number, (kind, identity) in enumerate(things):
        report("import", number, len(things))
        try:
            copy_thing(source, registry, kind, identity)
        except (CorruptError, DiffersError) as error:
            left_out.append(f"{kind} {identity[:12]}: {error.problem}")
    report("import", len(things), len(things))
    now = _ids(registry)
    added = {kind: len(set(theirs[kind]) & set(now[kind]) - set(before[kind])) for kind in _IDS}
    known = {kind: len(set(theirs[kind]) & set(before[kind])) for kind in _IDS}
    return Imported(added, known, tuple(left_out))


def _ids(registry: Registry) -> dict[str, list[str]]:
    """Ids by kind; those that have an order in theirs."""
    with registry.directory.catalog.read() as connection:
        return {
            kind: list(connection.execute(select(c).order_by(c.table.c.get("ordinal", c))).scalars())
            for kind, c in _IDS.items()
        }


def _taken_names(registry: Registry, source: Registry) -> Iterator[str]:
    """Names that mean one recording here and another there."""
    here = recordings_of_names(registry.directory)
    for name, identity in recordings_of_names(source.directory).items():
        if here.get(name, identity) != identity:
            yield f"the name {name!r} of recording {identity[:12]}: here it means recording {here[name][:12]}"
