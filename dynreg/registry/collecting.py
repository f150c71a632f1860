"""Files that a registry need not keep: unnamed files, unfinished work, and computed things."""

import os
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sqlalchemy import Column, Connection, select

import dynreg.registry.tables as tables
from dynreg.errors import Assumed, CorruptError, RegistryError
from dynreg.registry.cache import is_sound
from dynreg.registry.catalog import FILE
from dynreg.registry.directory import Directory
from dynreg.registry.files import (
    CACHE,
    CONTENTS,
    INDEX,
    LEDGER,
    ROBOTS,
    abandoned,
    is_content,
    is_passed_over,
    is_temporary,
    sweep,
    try_lock,
)
from dynreg.registry.hashes import hashes_of_first
from dynreg.registry.indexes import read_index
from dynreg.registry.ledger import Page, decode_page, page_name, read_ledger
from dynreg.registry.registry import Registry
from dynreg.registry.sharing import PARTS
from dynreg.registry.sweeping import remove_files, size_of
from dynreg.registry.tables import named

DAYS = 7  # after which a copy of a read-only registry's catalogue is nobody's any more
_NAMED_BY_NOTHING = "nothing names it"
_AGAIN = "it can be computed again"
_DAMAGED = "it is damaged"
_ELSEWHERE = "it is a copy of what lies in the bucket"


@dataclass(frozen=True)
class Unneeded:
    """A file or folder that need not be kept: its path in the registry (else from the root), why, and its bytes.

    cut_short : the work of a writer that is gone, which a sweep removes where no other begins at that moment.
    """

    path: str
    why: str
    size: int
    cut_short: bool = False


def collect(registry: Registry, *, caches: bool = False, dry_run: bool = False) -> tuple[Unneeded, ...]:
    """Remove what the registry need not keep; returns what it was.

    That is files that no row names, such as those of a put or a removal that was cut short; indexes of entries that are
    not there any more; damaged indexes and files of the cache; and copies of catalogues that read-only registries left
    in the folder for temporary files. caches : all of the cache and all indexes, too. dry_run : say so,
    and remove nothing. Warns (`Assumed`) of a page that may be of a put which the catalogue of a shared registry lost
    in a backup: it is kept with its files.

    Raises RegistryError where the registry may not be written, or its ledger is damaged: files that nothing names are
    then what a repair needs.
    """
    registry.check_writable()
    root, directory = registry.path, registry.directory
    with directory.catalog.write() as writing:  # nobody registers anything meanwhile
        directory.take_time(writing.connection)
        if directory.bucket is None:
            _require_ledger(root, writing.connection)
            found, doubted = [], ()
        else:
            found, doubted = _unnamed_pages(directory, writing.connection)
        found += [
            *_unnamed(directory, writing.connection, doubted),
            *_stale(directory, writing.connection, caches),
        ]
        found += [_cut_short(root, path) for path in abandoned(root)]
        if not dry_run:
            directory.remove([one.path for one in found if not one.cut_short])
    copies = list(_copies(root)) if caches and directory.bucket is not None else []
    left = list(_left_by_readers())
    if not dry_run:
        remove_files(root, [one.path for one in copies])
        sweep(root)
        remove_files(Path("/"), [one.path.lstrip("/") for one in left])
    return (*found, *copies, *left)


def _copies(root: Path) -> Iterator[Unneeded]:
    """What lies here of a shared registry's files, whole or in part."""
    for folder in (*CONTENTS, INDEX, f"{CACHE}/{PARTS}"):
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and not is_temporary(path.name):
                yield Unneeded(path.relative_to(root).as_posix(), _ELSEWHERE, size_of(path))


def _require_ledger(root: Path, connection: Connection) -> None:
    ledger = read_ledger(root)
    present = {page.number: sha256 for page, sha256 in ledger.pages}
    begins = min(present, default=0)
    rows = connection.execute(select(tables.pages.c.number, tables.pages.c.sha256))
    if ledger.bad or any(row.number >= begins and present.get(row.number) != row.sha256 for row in rows):
        raise _ledger_lost(str(root))


def _ledger_lost(where: str) -> RegistryError:
    return RegistryError(
        f"pages of the ledger of {where!r} are lost or damaged",
        expected=f"every page in {LEDGER}/ as it was written: a repair may need files that nothing names",
        do="run `dynreg verify --repair` first",
    )


def _unnamed_pages(directory: Directory, connection: Connection) -> tuple[list[Unneeded], tuple[Page, ...]]:
    """Pages of a shared ledger that are nobody's, as the catalogue does not name them; and those in doubt.

    One of a number with which the catalogue has gone on is of a put that was cut short. One that follows the
    catalogue's last page may be of such a put, or the last page from before the catalogue was put back from a backup:
    nothing tells which, so it is kept, and a warning says so.

    Raises RegistryError where a page that the catalogue names is gone, or where it surely was put back.
    """
    rows = connection.execute(select(tables.pages.c.number, tables.pages.c.sha256)).all()
    followed = {page_name(row.number, row.sha256) for row in rows}
    there = directory.bucket.names(LEDGER)
    if followed - there.keys():
        raise _ledger_lost(_bucket_of(directory))
    first, last = (of((row.number for row in rows), default=0) for of in (min, max))
    unnamed = sorted(there.keys() - followed)
    # what comes before the first is of no use since a repair began the ledger anew
    pages = {name: _fetched(directory, name) for name in unnamed if name >= page_name(first, "")}
    before = {page.before for page, _ in pages.values()}
    if any(page.number > last + 1 or sha256 in before for page, sha256 in pages.values()):
        raise RegistryError(
            f"the catalogue of {str(directory.path)!r} is older than the ledger in its bucket",
            expected="a catalogue that follows its ledger: what came since would be removed",
            do="run `dynreg verify --repair` first, which brings it back",
        )
    doubted = {name: page for name, (page, _) in pages.items() if page.number > last}
    if doubted:
        warnings.warn(
            f"the page {min(doubted)!r} and the files that it names are kept: its put was cut short, or the catalogue"
            " was put back from a backup. `dynreg verify --repair` takes it into the catalogue; after the next put"
            " `dynreg gc` removes it",
            Assumed,
            3,
        )
    gone = [Unneeded(name, _NAMED_BY_NOTHING, there[name]) for name in unnamed if name not in doubted]
    return gone, tuple(doubted.values())


def _fetched(directory: Directory, name: str) -> tuple[Page, str]:
    """A page in the bucket, and its sha256; RegistryError where it is damaged: what it names is unknown then."""
    try:
        return decode_page(name.rpartition("/")[2], directory.bucket.read(name))
    except (OSError, ValueError) as error:
        raise _ledger_lost(_bucket_of(directory)) from error


def _bucket_of(directory: Directory) -> str:
    return str(directory.bucket.uri.partition("?")[0])


def _unnamed(directory: Directory, connection: Connection, doubted: tuple[Page, ...]) -> Iterator[Unneeded]:
    """Files of contents that no row names, of the catalogue or of pages in doubt; of a known robot only log maps."""

    def told(column: Column[str]) -> set[str]:
        table, rows = column.table, set(connection.execute(select(column)).scalars())
        return rows | {
            named(table, row)[column.name] for page in doubted for row in page.put.get(table.name, ())
        }

    files, robots = told(tables.files.c.path), told(tables.robots.c.hash)
    for folder in CONTENTS:
        for name in directory.names(folder):
            if name in files or is_passed_over(name) or (directory.path / name).is_symlink():
                continue
            if folder == ROBOTS and name.split("/")[1] in robots:
                continue  # a put sweeps its maps, and what else is there is a fault
            yield Unneeded(name, _NAMED_BY_NOTHING, directory.size(name))


def _stale(directory: Directory, connection: Connection, caches: bool) -> Iterator[Unneeded]:
    """Indexes and files of the cache that nobody can use; or all of them."""
    populations = set(connection.execute(select(tables.populations.c.id)).scalars())
    table = tables.entries

    @cache
    def of_first(owner: str) -> dict[str, int]:
        ids = select(table.c.id).where(table.c.population_id == owner).order_by(table.c.number)
        return hashes_of_first(connection.execute(ids).scalars())

    for name in directory.names(INDEX):
        if is_passed_over(name) or (directory.path / name).is_symlink():
            continue
        try:
            header = read_index(directory.brought(name))[0]
            owner = header["population"]
            # an index of the first entries is what a population that grew is linked from
            fits = owner in populations and header["entries"] in of_first(owner)
            why = _AGAIN if fits else "its entries are not there any more"
        except CorruptError:
            fits, why = False, _DAMAGED
        if caches or not fits:
            yield Unneeded(name, why, directory.size(name))
    root = directory.path
    for path in sorted((root / CACHE).rglob("*.json")):
        sound = is_sound(path)
        if is_content(path.name) and (caches or not sound):
            why = _AGAIN if sound else _DAMAGED
            yield Unneeded(path.relative_to(root).as_posix(), why, size_of(path))


def _cut_short(root: Path, path: Path) -> Unneeded:
    return Unneeded(
        path.relative_to(root).as_posix(), "its writer was cut short", size_of(path), cut_short=True
    )


def _left_by_readers() -> Iterator[Unneeded]:
    """Copies of catalogues that were made for registries that may only be read, whose processes were killed."""
    for folder in sorted(Path(tempfile.gettempdir()).glob("dynreg-*")):
        catalog = folder / FILE
        try:
            old = time.time() - catalog.stat().st_mtime > DAYS * 86400
            mine = folder.stat().st_uid == catalog.stat().st_uid == _user()
        except OSError:
            continue
        if not (old and mine and (folder / LEDGER).is_dir()) or folder.is_symlink():
            continue
        with try_lock(folder, create=False) as nobodys:  # a reader that still runs holds it
            if nobodys:
                why = f"a read-only registry left it more than {DAYS} days ago"
                yield Unneeded(folder.as_posix(), why, size_of(folder))


def _user() -> int:
    """The user of this process; 0, that of every file, on a system that knows none."""
    return os.getuid() if hasattr(os, "getuid") else 0
