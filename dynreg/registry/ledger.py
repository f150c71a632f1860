"""The ledger: what was put into a registry, in order, a page for each put.

A page is a small file that is never changed: the rows that the put wrote to the catalogue, and the hash of the page
before. So the catalogue can be written again from the pages whole, with the names and the order that no other file
tells; a page whose rows did not reach the catalogue is taken over when the registry is opened.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import Table

import dynreg.registry.tables as tables
from dynreg.registry.codec import canonical_json
from dynreg.registry.files import (
    LEDGER,
    ROBOTS,
    StoredFile,
    content_name,
    is_litter,
    read_regular,
    write_file,
)
from dynreg.registry.tables import Key, Values, key_of, values_of

_NAME = re.compile(r"(\d{8,15})-([0-9a-f]{16})\.json")


@dataclass(frozen=True)
class Page:
    """One put.

    Attributes
    ----------
    number : 1 for the first page of a ledger.
    before : sha256 of the page before, "" for a page that begins anew.
    put : rows that were written, by table; a row takes the place of one with the same key.
    removed : keys of the rows that were taken out, by table.
    whole : whether it holds every row, so that the pages before it count no more.
    """

    number: int
    before: str = ""
    put: Mapping[str, tuple[Values, ...]] = field(default_factory=dict)
    removed: Mapping[str, tuple[Key, ...]] = field(default_factory=dict)
    whole: bool = False


@dataclass(frozen=True)
class Ledger:
    """The pages that could be read, each with its sha256, in order; and why others could not, by path."""

    pages: tuple[tuple[Page, str], ...]
    bad: Mapping[str, str]


def write_page(root: Path, page: Page) -> str:
    """Bring a page to the disk; returns its sha256."""
    file, data = encode_page(page)
    write_file(root / file.path, data)
    return file.sha256


def page_name(number: int, sha256: str) -> str:
    """Where a page lies, by its number and the hash of its bytes."""
    return f"{LEDGER}/{number:08d}-{sha256[:16]}.json"


def encode_page(page: Page) -> tuple[StoredFile, bytes]:
    """The file of a page."""
    document = {
        "schema": "dynreg/ledger/1",
        "number": page.number,
        "before": page.before,
        "whole": page.whole,
        "put": {
            name: {"columns": [c.name for c in tables.metadata.tables[name].c], "rows": rows}
            for name, rows in page.put.items()
        },
        "removed": dict(page.removed),
    }
    data = canonical_json(document).encode()
    return content_name(LEDGER, f"{page.number:08d}", data, "json"), data


def last_number(root: Path) -> int:
    """The number of the last page that is as it was written; 0 where there is none."""
    return max((page.number for page, _ in read_ledger(root).pages), default=0)


def pages_after(root: Path, number: int) -> list[Path]:
    """The files of the pages that come after `number`, in order."""
    found = (_NAME.fullmatch(path.name) for path in _files(root))
    later = sorted((int(m[1]), m[0]) for m in found if m and int(m[1]) > number)
    return [root / LEDGER / name for _, name in later]


def read_page(path: Path) -> tuple[Page, str]:
    """A page and its sha256; ValueError or OSError where the file is not as it was written."""
    return decode_page(path.name, read_regular(path))


def decode_page(name: str, data: bytes) -> tuple[Page, str]:
    """The page in a file of this name, and its sha256; ValueError where its bytes are not those that were written."""
    named = _NAME.fullmatch(name)
    if named is None:
        raise ValueError("no name of a page")
    sha256 = content_name(LEDGER, named[1], data, "json").sha256
    if sha256[:16] != named[2]:
        raise ValueError("its bytes do not fit the hash in its name")
    try:
        document = json.loads(data)
        put = {
            name: tuple(_in_order(name, told["columns"], row) for row in told["rows"])
            for name, told in document["put"].items()
        }
        removed = {name: tuple(_key(name, key) for key in keys) for name, keys in document["removed"].items()}
        number, before, whole = document["number"], document["before"], document["whole"]
        if type(number) is not int or not isinstance(before, str) or not isinstance(whole, bool):
            raise ValueError("its head is of another kind")
        page = Page(number, before, put, removed, whole)
    except (KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"it does not hold a page: {error!r}") from error
    if page.number != int(named[1]):
        raise ValueError("its number is not the one in its name")
    return page, sha256


def read_ledger(root: Path) -> Ledger:
    """Every page from the last whole one on; a page that is missing between two others is in `bad`, too."""
    pages, bad = [], {}
    for path in pages_after(root, 0):
        try:
            pages.append(read_page(path))
        except (OSError, ValueError) as error:
            bad[f"{LEDGER}/{path.name}"] = str(error)
    bad |= {f"{LEDGER}/{path.name}": "no page" for path in _files(root) if not _NAME.fullmatch(path.name)}
    begins = max((i for i, (page, _) in enumerate(pages) if page.whole), default=0)
    pages = pages[begins:]
    expected, before = 1, ""
    for page, sha256 in pages:
        if not page.whole and (page.number, page.before) != (expected, before):
            bad[f"{LEDGER}/{page.number:08d}"] = (
                "there are two of this number: copies of the registry were put together"
                if page.number < expected
                else f"page {expected} is missing"
                if page.number > expected
                else "it does not follow the page before"
            )
        expected, before = page.number + 1, sha256
    return Ledger(tuple(pages), bad)


def replay(pages: Iterable[Page]) -> dict[str, dict[Key, Values]]:
    """The rows that the pages leave, by table and key."""
    rows: dict[str, dict[Key, Values]] = {table.name: {} for table in tables.HELD}
    for page in pages:
        if page.whole:
            rows = {name: {} for name in rows}
        for name, keys in page.removed.items():
            for key in keys:
                rows[name].pop(key, None)
        for name, values in page.put.items():
            rows[name].update((key_of(tables.metadata.tables[name], row), row) for row in values)
    return rows


def removed_files(pages: Iterable[Page]) -> set[str]:
    """Paths of the files that pages took out and none put again; of a robot its folder, which ends in "/"."""
    gone: set[str] = set()
    for page in pages:
        for name, path in (("files", "{}"), ("robots", f"{ROBOTS}/{{}}/")):
            gone |= {path.format(key[0]) for key in page.removed.get(name, ())}
            gone -= {path.format(row[0]) for row in page.put.get(name, ())}
    return gone


def _in_order(name: str, columns: list[str], row: list[Any]) -> Values:
    table = _table(name)
    if sorted(columns) != sorted(c.name for c in table.c):
        raise ValueError(f"rows of {name!r} with the columns {columns}")
    values = values_of(table, dict(zip(columns, row, strict=True)))
    if problem := tables.misfit(table, values):
        raise ValueError(problem)
    return values


def _key(name: str, key: list[Any]) -> Key:
    if len(key) != len(_table(name).primary_key) or not all(isinstance(part, str | int) for part in key):
        raise ValueError(f"{key} is no key of {name!r}")
    return tuple(key)


def _table(name: str) -> Table:
    table = tables.metadata.tables.get(name)
    if table is None or table not in tables.HELD:
        raise ValueError(f"a ledger tells nothing of {name!r}")
    return table


def _files(root: Path) -> list[Path]:
    folder = root / LEDGER
    if not folder.is_dir():
        return []
    return [p for p in folder.iterdir() if not p.name.startswith(".") and not is_litter(p.name)]
