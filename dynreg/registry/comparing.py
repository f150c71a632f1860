"""What differs between the catalogue's rows and what the files hold."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import dynreg.registry.tables as tables
from dynreg.folder import MAPS
from dynreg.registry.files import CACHE, INDEX, ROBOTS, SEARCHES, StoredFile
from dynreg.registry.rebuild import Rows, manifest_of, paths_in
from dynreg.registry.scan import Found
from dynreg.registry.tables import Key

Keyed = Mapping[str, Mapping[Key, Mapping[str, Any]]]  # rows by table and key


@dataclass(frozen=True)
class Fault:
    """One thing that is not as it was registered.

    `kind` is "marker", "catalog", "ledger", "file" (one under another name), "robot", "population", "shard", "entries",
    "recording", "recording name", "simulator", "result", "index", "cache", "search", "row" or "stray"; `what` names it;
    `lost` tells that data are gone which the registry cannot bring back by itself; `mended` says what a repair did,
    None where it did nothing.
    """

    kind: str
    what: str
    problem: str
    lost: bool
    mended: str | None = None

    def __str__(self) -> str:
        return f"{self.kind} {self.what}: {self.problem}" + (f" ({self.mended})" if self.mended else "")


@dataclass(frozen=True)
class VerifyReport:
    """Faults, how many things of each kind were checked, and sound files that nothing put refers to.

    Such leftovers come from a process that was killed before its put was done. They are no fault: the same put takes
    them as they are.
    """

    faults: tuple[Fault, ...]
    checked: dict[str, int]
    leftovers: tuple[str, ...]

    @property
    def lost(self) -> tuple[Fault, ...]:
        """The faults that mean a loss of data."""
        return tuple(fault for fault in self.faults if fault.lost)


def compare(held: Rows, found: Found, faults: list[Fault]) -> VerifyReport:
    """The report on old rows against files; `faults` are those known already."""
    faults = [*faults, *_file_faults(held, found), *_entry_faults(held, found), *_row_faults(held, found)]
    known = paths_in(held)
    faults += [
        Fault(again(name), name, reason, lost=False)
        for name, reason in sorted(found.bad.items())
        if name not in known
    ]
    faults += _robot_faults(held, found)
    robots = {row["hash"] for row in held["robots"]}
    unknown = sorted(set(found.files) - known - set(found.bad))
    leftovers = [n for n in unknown if not (n.startswith(f"{ROBOTS}/") and n.split("/")[1] in robots)]
    checked = {name: len(rows) for name, rows in held.items()}
    return VerifyReport(tuple(faults), checked, tuple(leftovers))


_AGAIN = {INDEX: "index", CACHE: "cache", SEARCHES: "search"}  # what can be computed again


def again(name: str) -> str:
    """The kind of fault of a file that no row knows, by its folder."""
    return _AGAIN.get(name.split("/")[0], "stray")


_FOLDER_KINDS = {
    "populations": "population",
    "shards": "shard",
    "recordings": "recording",
    "measured": "measured",
    "simulators": "simulator",
    "results": "result",
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
        yield Fault(kind, path, problem, lost=True)


def _robot_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Files of robots that are missing, changed or more than were registered."""
    for row in held["robots"]:
        prefix = f"{ROBOTS}/{row['hash']}/"
        present = {n.removeprefix(prefix): f.sha256 for n, f in found.files.items() if n.startswith(prefix)}
        manifest = manifest_of(row)
        for name in sorted({*present, *manifest}):
            is_map = name.split("/")[0] == MAPS  # a put that was cut short leaves new ones, or some of both
            if name not in manifest:
                if not is_map:
                    yield Fault(
                        "stray", prefix + name, "no file of the robot as it was registered", lost=False
                    )
            elif present.get(name) != manifest[name]:
                changed = "its bytes are not those that were registered"
                yield Fault(
                    "robot", prefix + name, changed if name in present else "it is missing", not is_map
                )
        if not manifest:
            yield Fault("robot", prefix, "nothing tells which files it had", lost=True)


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


def _row_faults(held: Rows, found: Found) -> Iterator[Fault]:
    """Rows that refer to rows which are gone, and rows that do not say what their files say."""
    keys = {name: {_first_key(name, row) for row in rows} for name, rows in held.items()}
    for table in tables.HELD:
        for key in table.foreign_keys:
            parent = key.column.table.name
            for row in held[table.name]:
                if row[key.parent.name] not in keys[parent]:
                    what = f"{table.name} {_first_key(table.name, row)!s:.24}"
                    yield Fault("row", what, f"its row in {parent} is gone", lost=False)
    for row in held["shards"]:
        sound = found.shards.get((row["population_id"], row["start"]))
        if sound is not None and sound.row != row:
            yield Fault("row", f"shard from {row['start']}", "its row is not what its files say", lost=False)


def differing_rows(stored: Keyed, told: Keyed) -> Iterator[Fault]:
    """Rows of the catalogue that the ledger's pages lack, and the other way round."""
    for name in stored:
        kind = "entries" if name == tables.entries.name else "row"
        for key in sorted({*stored[name], *told[name]}, key=repr):
            mine, right = stored[name].get(key), told[name].get(key)
            if mine == right:
                continue
            if mine is None or right is None:
                problem = "its row is gone" if mine is None else "a row that nobody put"
            else:
                changed = [column for column in right if mine[column] != right[column]]
                problem = f"{', '.join(changed)} differs from what was put"
            yield Fault(kind, f"{name} {' '.join(str(part)[:24] for part in key)}", problem, lost=False)


def _first_key(name: str, row: dict[str, Any]) -> Any:
    return row[next(iter(tables.metadata.tables[name].primary_key)).name]
