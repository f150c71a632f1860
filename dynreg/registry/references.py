"""A person's word for a thing, resolved to its id."""

import difflib
import re
import warnings
from collections.abc import Collection

from sqlalchemy import Connection, select

import dynreg.registry.tables as tables
from dynreg.errors import AmbiguousError, Assumed, NoMatchError, RegistryError, quoted
from dynreg.registry.versions import newest

LAST = "@last"
ID_COLUMNS = {
    "robot": tables.robots.c.hash,
    "population": tables.populations.c.id,
    "entry": tables.entries.c.id,
    "recording": tables.recordings.c.id,
    "measured": tables.measured.c.id,
    "simulator": tables.simulators.c.id,
    "result": tables.results_of_verbs.c.id,
}
_NAME_COLUMNS = {
    "robot": (tables.robots.c.name, tables.robots.c.hash),  # of which the newest version has it
    "population": (tables.populations.c.name, tables.populations.c.id),
    "recording": (tables.recording_names.c.name, tables.recording_names.c.recording_id),
}
KINDS = tuple(ID_COLUMNS)
_PREFIX = re.compile(r"[0-9a-f]{4,}")
_SHOWN = 5


def resolve(connection: Connection, ref: str, kinds: Collection[str] = KINDS) -> tuple[str, str]:
    """(kind, id) of `ref`: a content hash, a name, a unique prefix of a hash (4 digits or more), or `@last`.

    A name goes before a prefix, and where it could be one a warning says so (`Assumed`). The name of a robot means its
    newest version. `@last` is the recording ingested last, never a result.

    Raises
    ------
    NoMatchError : nothing has this name or hash, or several do; the message shows what comes near.
    RegistryError : `kinds` holds a word that is no kind.
    """
    if not set(kinds) <= set(KINDS):
        raise RegistryError(
            f"kinds {quoted(sorted(kinds))}", expected=f"some of {quoted(KINDS)}", do="name only these"
        )
    if ref == LAST and "recording" in kinds:
        return "recording", _last(connection)
    # SQLite takes no half of a surrogate pair, as a word has that is no UTF-8, and no name holds one
    for find in (_by_id, _by_name, _by_number, _by_prefix) if ref.isprintable() else ():
        found = find(connection, ref, kinds)
        if len(found) == 1:
            if find is _by_name:
                _say_what_else(connection, ref, found[0], kinds)
            return found[0]
        if found:
            shown = ", ".join(f"{kind} {identity[:16]}" for kind, identity in found[:_SHOWN])
            raise AmbiguousError(
                f"{ref!r} fits more than one: {shown}{', ...' if len(found) > _SHOWN else ''}",
                expected="a hash, a unique prefix of one, or a name that one thing alone has",
                do="give the first digits of the id of the one you mean"
                if find is _by_name
                else "give more digits of the one you mean",
            )
    columns = [name for kind, (name, _) in _NAME_COLUMNS.items() if kind in kinds]
    names = {name for column in columns for name in connection.execute(select(column)).scalars()}
    names |= {LAST} if "recording" in kinds else set()
    near = difflib.get_close_matches(ref, sorted(names), n=3, cutoff=0.5)
    raise NoMatchError(
        f"no {' or '.join(kinds) if len(kinds) < len(KINDS) else 'stored thing'} is called {ref!r}",
        expected="a hash, a unique prefix of 4 digits or more, "
        + (f"{LAST} (the last recording), or a name" if "recording" in kinds else "or a name")
        + (f" (near: {', '.join(near)})" if near else ""),
        do="see `dynreg list` for what there is",
    )


def holds(connection: Connection, kind: str, identity: str) -> bool:
    """Whether there is a thing of this kind with this whole id."""
    column = ID_COLUMNS[kind]
    return connection.execute(select(column).where(column == identity)).first() is not None


def _last(connection: Connection) -> str:
    table = tables.recordings
    found = connection.execute(select(table.c.id).order_by(table.c.ordinal.desc()).limit(1)).scalar()
    if found is None:
        raise NoMatchError(
            "there is no last recording",
            expected=f"an ingested one ({LAST} is the last recording; in `dynreg report` the last result)",
            do="ingest a log first, or see the results with `dynreg list --kind result`",
        )
    return found


def _by_id(connection: Connection, ref: str, kinds: Collection[str]) -> list[tuple[str, str]]:
    columns = {kind: ID_COLUMNS[kind] for kind in KINDS if kind in kinds}
    return [
        (k, i) for k, c in columns.items() for i in connection.execute(select(c).where(c == ref)).scalars()
    ]


def _by_name(connection: Connection, ref: str, kinds: Collection[str]) -> list[tuple[str, str]]:
    found = [
        (kind, identity)
        for kind, (name, column) in _NAME_COLUMNS.items()
        if kind in kinds
        for identity in connection.execute(select(column).where(name == ref)).scalars()
    ]
    if sum(kind == "robot" for kind, _ in found) > 1:
        last = newest(connection, ref).hash
        found = [(kind, identity) for kind, identity in found if kind != "robot" or identity == last]
    return found


def _say_what_else(connection: Connection, ref: str, found: tuple[str, str], kinds: Collection[str]) -> None:
    """Warn where a name that was found is the beginning of another thing's hash, too."""
    others = [other for other in _by_prefix(connection, ref, kinds) if other != found]
    if others:
        kind, identity = others[0]
        warnings.warn(
            f"{ref!r} is taken as the name of {found[0]} {found[1][:12]}; "
            f"{kind} {identity[:12]} begins so, too: give more of its digits if you mean that",
            Assumed,
            2,
        )


def _by_number(connection: Connection, ref: str, kinds: Collection[str]) -> list[tuple[str, str]]:
    """Entries by the name of their population and their number, as lists show them; a recording's by its name."""
    found = []
    name, _, number = ref.rpartition("-")
    if "entry" in kinds and number.isdecimal():
        entries, populations = tables.entries.c, tables.populations.c
        query = select(entries.id).join(tables.populations).where(populations.name == name)
        rows = connection.execute(query.where(entries.number == int(number[:18])))
        found += [("entry", identity) for identity in rows.scalars()]
    if "measured" in kinds and "recording" not in kinds:
        query = select(tables.measured.c.id).join(
            tables.recording_names, tables.recording_names.c.recording_id == tables.measured.c.recording_id
        )
        rows = connection.execute(query.where(tables.recording_names.c.name == ref))
        found += [("measured", identity) for identity in rows.scalars()]
    return found


def _by_prefix(connection: Connection, ref: str, kinds: Collection[str]) -> list[tuple[str, str]]:
    if not _PREFIX.fullmatch(ref):
        return []
    found = []
    for kind in (kind for kind in KINDS if kind in kinds):
        column = ID_COLUMNS[kind]
        # "g" comes after every hexadecimal digit: a range that the key's index serves.
        query = select(column).where(column >= ref, column < f"{ref}g").order_by(column).limit(_SHOWN + 1)
        found += [(kind, identity) for identity in connection.execute(query).scalars()]
    return found
