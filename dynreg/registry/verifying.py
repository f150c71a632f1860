"""Is everything that was stored still there? What was lost is said, what can be rebuilt is rebuilt."""

import json
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, select, text

from dynreg.errors import CorruptError, DynregError, RegistryError
from dynreg.registry import tables
from dynreg.registry.catalog import FILE, Catalog
from dynreg.registry.directory import check_marker, make_folders
from dynreg.registry.files import LOST_AND_FOUND, ROBOTS, StoredFile, sweep
from dynreg.registry.rebuild import Rows, replace_rows
from dynreg.registry.scan import Found, scan


@dataclass(frozen=True)
class Fault:
    """One thing that is not as it was registered.

    `kind` is "catalog", "robot", "population", "shard", "entries", "recording", "simulator", "result",
    "index", "row" or "stray"; `what` names it; `lost` tells that data are gone which the registry cannot
    bring back by itself; `mended` says what a repair did, None where it did nothing.
    """

    kind: str
    what: str
    problem: str
    lost: bool
    mended: str | None = None


@dataclass(frozen=True)
class VerifyReport:
    """Faults, how many things of each kind were checked, and sound files that no catalogue row knows.

    Such leftovers come from a process that was killed between its files and its transaction; they are no
    fault, and a repair adopts them.
    """

    faults: tuple[Fault, ...]
    checked: dict[str, int]
    leftovers: tuple[str, ...]

    @property
    def lost(self) -> tuple[Fault, ...]:
        """The faults that mean a loss of data."""
        return tuple(fault for fault in self.faults if fault.lost)

    def raise_if_lost(self) -> None:
        """CorruptError when data are lost."""
        if self.lost:
            first = self.lost[0]
            raise CorruptError(
                f"{len(self.lost)} losses, the first: {first.kind} {first.what}: {first.problem}",
                expected="every stored file as it was registered",
                do="populate or ingest again what was lost"
                if first.mended
                else "run `dynreg verify --repair`",
            )


def verify(path: Path, repair: bool = False) -> VerifyReport:
    """Compare catalogue and files of the registry at `path`, hash by hash and row by row.

    With `repair` the catalogue is brought in line with the files: lost entries are taken out, so that a
    populate computes them again; sound files without a row are adopted; all other strange files are moved
    to `lost+found/`; stale indexes are dropped; a damaged catalogue is written anew. Populations and
    robots that lost their own files stay, to be healed by putting them again. Other writers wait meanwhile.

    Raises RegistryError when there is no registry at `path`, or when it cannot be written for a repair.
    """
    path = Path(path)
    check_marker(path)
    held, faults = _read_catalog(path)
    if not repair:
        found = scan(path, _paths(held))
        still = _paths(_read_catalog(path)[0])  # an index may be replaced while the files are read
        for name in ("files", "indexes"):
            held[name] = [row for row in held[name] if row["path"] in still]
        return _compare(held, found, faults)
    if not os.access(path, os.W_OK):
        raise RegistryError(f"{str(path)!r} is read-only", expected="a writable registry", do="copy it first")
    make_folders(path)
    damaged = bool(faults)
    if damaged:
        _put_away(path, [name for name in (FILE, f"{FILE}-wal", f"{FILE}-shm") if (path / name).exists()])
    catalog = Catalog(path)
    try:
        with catalog.write() as connection:
            held = held if damaged else _read_rows(connection)
            found = scan(path, _paths(held))
            report = _compare(held, found, faults)
            put_away = replace_rows(connection, path, held, found)
            _put_away(path, put_away)
    finally:
        catalog.close()
    sweep(path)
    return replace(
        report, faults=tuple(replace(fault, mended=_MENDED.get(fault.kind)) for fault in report.faults)
    )


_HEALED_BY_PUTTING = ("robot", "population")
_MENDED = {
    "catalog": "written anew from the stored files",
    "shard": "taken out of the catalogue; a populate computes it again",
    "entries": "rows written anew from the shard",
    "recording": "taken out of the catalogue; ingest its log again",
    "simulator": "taken out of the catalogue",
    "result": "taken out of the catalogue; the command that made it computes it again",
    "index": "dropped; it is computed again when it is needed",
    "row": "written anew from the stored files, or taken out",
    "stray": f"moved to {LOST_AND_FOUND}/",
}


def _read_catalog(path: Path) -> tuple[Rows, list[Fault]]:
    """The catalogue's rows, as far as they can be read, and its own faults."""
    empty: Rows = {name: [] for name in tables.metadata.tables}
    if not (path / FILE).exists():
        return empty, [Fault("catalog", FILE, "it is missing", lost=True)]
    try:
        catalog = Catalog(path)
    except CorruptError as error:
        return empty, [Fault("catalog", FILE, error.problem, lost=True)]
    try:
        with catalog.read() as connection:
            sound = connection.execute(text("PRAGMA integrity_check")).scalars().all()
            rows = _read_rows(connection)
        faults = [] if sound == ["ok"] else [Fault("catalog", FILE, "; ".join(sound[:3]), lost=True)]
        return rows, faults
    except DynregError as error:
        return empty, [Fault("catalog", FILE, error.problem, lost=True)]
    finally:
        catalog.close()


def _read_rows(connection: Connection) -> Rows:
    return {
        name: [dict(row) for row in connection.execute(select(table)).mappings()]
        for name, table in tables.metadata.tables.items()
    }


def _paths(held: Rows) -> set[str]:
    """Paths that some row refers to: those of `files`, and those of rows whose `files` row is gone."""
    columns = ("path", "states_path", "arrays_path")
    return {row[column] for rows in held.values() for row in rows for column in columns if row.get(column)}


def _compare(held: Rows, found: Found, faults: list[Fault]) -> VerifyReport:
    faults = [*faults, *_file_faults(held, found), *_entry_faults(held, found), *_index_faults(held, found)]
    faults += _row_faults(held, found)
    known = _paths(held)
    faults += [
        Fault("stray", name, reason, lost=False)
        for name, reason in sorted(found.bad.items())
        if name not in known
    ]
    faults += _robot_faults(held, found)
    robots = {row["hash"] for row in held["robots"]}
    unknown = sorted(set(found.files) - known - set(found.bad))
    leftovers = [n for n in unknown if not (n.startswith(f"{ROBOTS}/") and n.split("/")[1] in robots)]
    checked = {name: len(rows) for name, rows in held.items() if name != "migrations"}
    return VerifyReport(tuple(faults), checked, tuple(leftovers))


_FOLDER_KINDS = {
    "populations": "population",
    "shards": "shard",
    "recordings": "recording",
    "simulators": "simulator",
    "results": "result",
    "index": "index",
}


def _file_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Registered files that are missing or no longer the same."""
    for row in held["files"]:
        path = row["path"]
        kind = _FOLDER_KINDS.get(path.split("/")[0], "stray")
        if path in found.bad:
            problem = found.bad[path]
        elif path not in found.files:
            problem = "it is missing"
        elif found.files[path] != StoredFile(path, row["sha256"], row["size"]):
            problem = "its bytes are not those that were registered"
        else:
            continue
        yield Fault(kind, path, problem, lost=kind != "index")


def _robot_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Files of robots that are missing, changed or more than were registered."""
    for row in held["robots"]:
        prefix = f"{ROBOTS}/{row['hash']}/"
        present = {n.removeprefix(prefix): f.sha256 for n, f in found.files.items() if n.startswith(prefix)}
        manifest = json.loads(row["manifest"])
        for name in sorted({*present, *manifest}):
            if name not in manifest:
                yield Fault("stray", prefix + name, "no file of the robot as it was registered", lost=False)
            elif present.get(name) != manifest[name]:
                problem = (
                    "its bytes are not those that were registered" if name in present else "it is missing"
                )
                yield Fault("robot", prefix + name, problem, lost=True)
        if not manifest:
            yield Fault("robot", prefix, "its folder is missing", lost=True)


def _entry_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Shards whose rows of entries are not what their files say."""
    rows: dict[str, dict[int, dict[str, Any]]] = {}
    for row in held["entries"]:
        rows.setdefault(row["population_id"], {})[row["number"]] = row
    for shard in held["shards"]:
        population, start, stop = shard["population_id"], shard["start"], shard["stop"]
        mine = [rows.get(population, {}).pop(number, None) for number in range(start, stop)]
        sound = found.shards.get((population, start))
        if sound is None or sound.row != shard:
            continue  # said of its files, or of its row
        wrong = sum(a != b for a, b in zip(mine, sound.entries, strict=True))
        if wrong:
            problem = f"{wrong} of {stop - start} rows are not what its files say"
            yield Fault("entries", f"{population[:12]} from {start}", problem, lost=False)
    for population, left in rows.items():
        if left:
            yield Fault("row", f"entries of {population[:12]}", f"{len(left)} belong to no shard", lost=False)


def _index_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Indexes of a population whose entries have changed are stale, no fault; a changed row is one."""
    for row in held["indexes"]:
        sound = found.indexes.get((row["population_id"], row["key"]))
        if sound is not None and sound != row:
            yield Fault("index", row["path"], "its row is not what its file says", lost=False)


def _row_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Rows that refer to rows which are gone, and rows that do not say what their files say."""
    keys = {name: {_first_key(name, row) for row in rows} for name, rows in held.items()}
    for name, table in tables.metadata.tables.items():
        for key in table.foreign_keys:
            parent = key.column.table.name
            for row in held[name]:
                if row[key.parent.name] not in keys[parent]:
                    what = f"{name} {_first_key(name, row)!s:.24}"
                    yield Fault("row", what, f"its row in {parent} is gone", lost=False)
    for row in held["shards"]:
        sound = found.shards.get((row["population_id"], row["start"]))
        if sound is not None and sound.row != row:
            yield Fault("row", f"shard from {row['start']}", "its row is not what its files say", lost=False)


def _first_key(name: str, row: dict[str, Any]) -> Any:
    return row[next(iter(tables.metadata.tables[name].primary_key)).name]


def _put_away(root: Path, names: list[str]) -> None:
    place = root / LOST_AND_FOUND
    place.mkdir(exist_ok=True)
    for name in names:
        source = root / name
        if name.startswith("index/"):  # a cache
            source.unlink(missing_ok=True)
        elif source.exists() or source.is_symlink():
            os.replace(source, place / f"{name.replace('/', '--')}.{secrets.token_hex(4)}")
    for folder in sorted((root / ROBOTS).rglob("*"), reverse=True):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
