"""The text of a drafted robot.toml."""

import textwrap
from collections.abc import Iterable, Iterator

from dynreg.draft.entry import Entry
from dynreg.draft.tables import Tables
from dynreg.tomlfile import literal

_WIDTH = 118
_COLUMN = 31
_DIGITS = 6  # of numbers: no model and no log tells more


def toml_of(tables: Tables) -> str:
    """robot.toml: notes as comments above, a word behind numbers on where they come from."""
    lines: list[str] = []
    lines += _comments(tables.notes)
    lines += _table("[robot]", tables.robot)
    for entry in tables.drives:
        lines += _table("[[drives]]", entry)
    for name in ("reset", "fall", "replay", "excitation"):
        entry = getattr(tables, name)
        lines += _table(f"[{name}]", entry) if entry is not None else []
    for name in ("actions", "channels", "parameters"):
        lines += ["", *_comments(tables.reasons)] if name == "parameters" and tables.reasons else []
        for entry in getattr(tables, name):
            lines += _table(f"[[{name}]]", entry)
    return "\n".join(lines).lstrip("\n") + "\n"


def _comments(notes: Iterable[str]) -> Iterator[str]:
    for note in notes:
        yield from textwrap.wrap(note, _WIDTH, initial_indent="# ", subsequent_indent="#   ")


def _table(head: str, entry: Entry) -> Iterator[str]:
    yield ""
    yield f"{head:{_COLUMN}}# {entry.said}" if entry.said else head
    for key, value in entry.values.items():
        yield f"{key} = {literal(value, _DIGITS)}"
