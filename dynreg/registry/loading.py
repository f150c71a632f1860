"""Entries back from their shards."""

from bisect import bisect_left
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import Connection, Row, select

import dynreg.registry.tables as tables
from dynreg.data.trajectories import Trajectories
from dynreg.errors import CorruptError, NoMatchError, RegistryError, quoted
from dynreg.registry.bucket import Remote, not_as_stored
from dynreg.registry.codec import decode_arrays
from dynreg.registry.directory import Directory
from dynreg.registry.populations import get_population
from dynreg.registry.records import EntryRecord, PopulationArrays, PopulationRecord, ShardData
from dynreg.registry.rows import require
from dynreg.registry.shards import read_shard, read_states, read_states_header, strip

COLUMNS = ("states", "weights")
# Entries that a part of a dataset holds: whole shards of 200, three of which are in memory, took 550 MB on quadrupeds.
PART = 100
_THREADS = 2  # shards decoded side by side; beyond two, memory is the limit


def load_population(
    directory: Directory, population_id: str, columns: Collection[str] = COLUMNS, since: int = 0
) -> PopulationArrays:
    """All entries of a population, stacked. columns : which of the large arrays "states" and "weights" to read.

    since : number of an entry; shards that end before it are left out.

    Raises
    ------
    NoMatchError : the population is unknown, or has no entries yet.
    CorruptError : a shard is missing or damaged.
    """
    if not set(columns) <= set(COLUMNS):
        raise RegistryError(
            f"columns {quoted(columns)}", expected=f"some of {quoted(COLUMNS)}", do="name only these"
        )
    record = get_population(directory, population_id)
    with directory.catalog.read() as connection:
        shards = [s for s in _shards(connection, population_id) if s.stop > since]
        begin, table = shards[0].start if shards else 0, tables.entries
        query = select(table.c.id, table.c.number).where(table.c.population_id == population_id)
        query = query.where(table.c.number >= begin).order_by(table.c.number)
        entries = connection.execute(query).all()
    numbers = np.array([row.number for row in entries], dtype=np.int64)
    _check_whole(population_id, shards, numbers)
    skip = "/" if "weights" in columns else "weights/"
    found = directory.checked if "weights" in columns else directory.near
    paths = found(*(shard.arrays_path for shard in shards))
    parts = [_rest(path, s.stop - s.start, record, skip) for path, s in zip(paths, shards, strict=True)]
    return PopulationArrays(
        ids=tuple(row.id for row in entries),
        numbers=numbers,
        parameters=record.parameters,
        values=_stack(parts, "values"),
        states=_states(directory, shards, record) if "states" in columns else None,
        weights=strip(_stack_all(parts, "weights/"), "weights/") if "weights" in columns else None,
        own_loss=_stack(parts, "own_loss"),
        train_loss=_stack(parts, "train_loss"),
        extra=strip(_stack_all(parts, "extra/"), "extra/"),
    )


def load_entry(directory: Directory, entry_id: str) -> EntryRecord:
    """One entry, read alone; NoMatchError when unknown, CorruptError when its shard is damaged."""
    with directory.catalog.read() as connection:
        entry = require(connection, tables.entries, entry_id, "entry")
        holds = [s for s in _shards(connection, entry.population_id) if s.start <= entry.number < s.stop]
    _check_whole(entry.population_id, holds, np.array([entry.number]), alone=True)
    position = entry.number - holds[0].start
    states_path, arrays_path = directory.near(holds[0].states_path, holds[0].arrays_path)
    record = get_population(directory, entry.population_id)
    header = _header(states_path, holds[0], record)
    states = np.empty((1, *header["shape"][1:]), np.float32)
    read_states(states_path, states, position)
    arrays = _rest(arrays_path, holds[0].stop - holds[0].start, record, only=[position])
    row = {name: array[0] for name, array in arrays.items()}
    found = EntryRecord(
        id=entry.id,
        population_id=entry.population_id,
        number=entry.number,
        values=dict(zip(record.parameters, row["values"].tolist(), strict=True)),
        states=states[0],
        weights=strip(row, "weights/"),
        own_loss=float(row["own_loss"]),
        train_loss=float(row["train_loss"]),
        extra={name: float(value) for name, value in strip(row, "extra/").items()},
        periods=None if header["periods"] is None else header["periods"][position],
    )
    fetched = [path for path in (states_path, arrays_path) if isinstance(path, Remote)]
    if fetched and found.as_shard().entry_id(found.population_id, 0) != entry.id:  # no hash was compared yet
        why = "the entry is not the one that was registered"
        raise [not_as_stored(one, why) for one in fetched][-1]
    return found


@dataclass(frozen=True, eq=False)
class ShardPart:
    """Some entries of one shard, read when they are asked for; needs no open registry.

    shape : (N, E, T+1, S) of the whole shard. positions : (n,) of the entries in it, in order. numbers : (n,) in the
    population.
    """

    path: Path | Remote
    shape: tuple[int, ...]
    record: PopulationRecord
    entries: tuple[str, ...]
    numbers: np.ndarray
    positions: np.ndarray

    @property
    def rows(self) -> int:
        """How many states."""
        return len(self.entries) * self.shape[1] * self.shape[2]

    @property
    def count(self) -> int:
        """How many transitions."""
        return len(self.entries) * self.shape[1] * (self.shape[2] - 1)

    @property
    def periods(self) -> np.ndarray:
        """(n E,) seconds from a state to the next, NaN where nobody told them; CorruptError as `read`."""
        told = read_states_header(self.path)["periods"]
        if told is None:
            return np.full(len(self.entries) * self.shape[1], np.nan)
        return told[self.positions].ravel()

    def read(self) -> tuple[Trajectories]:
        """What the entries did; CorruptError where the file is lost or damaged."""
        first, last = int(self.positions[0]), int(self.positions[-1])
        states = np.empty((last - first + 1, *self.shape[1:]), np.float32)
        read_states(self.path, states, first)
        periods = read_states_header(self.path)["periods"]
        if len(states) > len(self.positions):
            states = states[self.positions - first]
        periods = None if periods is None else periods[self.positions]
        return (self.record.trajectories(self.entries, self.numbers, states, periods),)


def shard_parts(
    directory: Directory, population_id: str, entries: Collection[str] | None = None
) -> tuple[ShardPart, ...]:
    """Where the rows of a population's entries are, or of those with these ids, by shard and number.

    Raises as `load_population`.
    """
    record = get_population(directory, population_id)
    places = _places(directory, population_id, entries)
    paths = _files(directory, places, "states_path")
    parts = []
    for (shard, own), path in zip(places, paths, strict=True):
        shape = tuple(_header(path, shard, record)["shape"])
        for begin in range(0, len(own), PART):
            some = own[begin : begin + PART]
            numbers = np.array([row.number for row in some])
            ids = tuple(row.id for row in some)
            parts.append(ShardPart(path, shape, record, ids, numbers, numbers - shard.start))
    return tuple(parts)


def load_weights(
    directory: Directory, population_id: str, entries: Collection[str]
) -> Iterator[dict[str, np.ndarray]]:
    """Weights of the models of these entries by name, each (n, ...), a shard at a time and by number.

    Of a shard in a bucket only these are fetched, where they are not all of it. Raises as `load_population`.
    """
    record = get_population(directory, population_id)
    places = _places(directory, population_id, entries)
    paths = _files(directory, places, "arrays_path")
    for (shard, own), path in zip(places, paths, strict=True):
        for begin in range(0, len(own), PART):
            positions = [row.number - shard.start for row in own[begin : begin + PART]]
            arrays = _rest(path, shard.stop - shard.start, record, only=positions)
            yield strip(arrays, "weights/")


def _places(
    directory: Directory, population_id: str, entries: Collection[str] | None
) -> list[tuple[Row, list[Row]]]:
    """Shards with the rows of their entries, by number: of all, or of those that hold some with these ids."""
    with directory.catalog.read() as connection:
        shards = _shards(connection, population_id)
        table = tables.entries
        query = select(table.c.id, table.c.number).where(table.c.population_id == population_id)
        rows = connection.execute(query.order_by(table.c.number)).all()
    _check_whole(population_id, shards, np.array([row.number for row in rows], dtype=np.int64))
    wanted = None if entries is None else set(entries)
    rows = [row for row in rows if wanted is None or row.id in wanted]
    numbers = [row.number for row in rows]
    held = [rows[bisect_left(numbers, s.start) : bisect_left(numbers, s.stop)] for s in shards]
    return [(shard, own) for shard, own in zip(shards, held, strict=True) if own]


def _files(directory: Directory, places: Sequence[tuple[Row, list[Row]]], column: str) -> list[Path | Remote]:
    """Where the shards' files lie, of which all is read: then they are compared with their hashes; or a part."""
    whole = [getattr(s, column) for s, own in places if len(own) == s.stop - s.start]
    part = [getattr(s, column) for s, own in places if len(own) < s.stop - s.start]
    found = dict(zip((*whole, *part), (*directory.checked(*whole), *directory.near(*part)), strict=True))
    return [found[getattr(shard, column)] for shard, _ in places]


def entry_place(directory: Directory, entry_id: str) -> tuple[str, int]:
    """The id of an entry's population, and its number in it; NoMatchError when unknown."""
    with directory.catalog.read() as connection:
        row = require(connection, tables.entries, entry_id, "entry")
    return row.population_id, row.number


def entry_numbers(directory: Directory, population_id: str) -> dict[str, int]:
    """{id of an entry: its number} of a population, by number; NoMatchError where it has none yet."""
    table = tables.entries
    query = select(table.c.id, table.c.number).where(table.c.population_id == population_id)
    with directory.catalog.read() as connection:
        shards = _shards(connection, population_id)
        rows = connection.execute(query.order_by(table.c.number)).all()
    _check_whole(population_id, shards, np.array([row.number for row in rows], dtype=np.int64))
    return {row.id: row.number for row in rows}


def load_shards(directory: Directory, population_id: str) -> Iterator[tuple[int, ShardData]]:
    """The shards of a population one after the other, with the number of their first entry."""
    with directory.catalog.read() as connection:
        shards = _shards(connection, population_id)
    record = get_population(directory, population_id)
    for shard in shards:
        paths = directory.checked(shard.states_path, shard.arrays_path)
        _header(paths[0], shard, record)
        _, data = read_shard(*paths)
        yield shard.start, data


def load_shard(directory: Directory, population_id: str, start: int) -> ShardData:
    """The shard of a population whose first entry has the number `start`; CorruptError where it is lost or damaged."""
    with directory.catalog.read() as connection:
        row = next((s for s in _shards(connection, population_id) if s.start == start), None)
    if row is None:
        raise NoMatchError(
            f"population {population_id[:12]} has no shard from entry {start} on",
            expected="a shard that was there a moment ago",
            do="run the same command again",
        )
    return read_shard(*directory.checked(row.states_path, row.arrays_path))[1]


def _shards(connection: Connection, population_id: str) -> Sequence[Row]:
    table = tables.shards
    return connection.execute(
        select(table).where(table.c.population_id == population_id).order_by(table.c.start)
    ).all()


def _check_whole(population_id: str, shards: Sequence[Row], numbers: np.ndarray, alone: bool = False) -> None:
    if not len(numbers):
        raise NoMatchError(
            f"population {population_id[:12]} has no entries yet",
            expected="at least one shard",
            do="run `dynreg populate` first",
        )
    count = sum(shard.stop - shard.start for shard in shards)
    whole = (
        bool(shards) if alone else count == len(numbers)
    )  # numbers are unique: they fill the shards, or not
    if whole and not alone:
        at = np.searchsorted([shard.start for shard in shards], numbers, side="right") - 1
        stops = np.array([shard.stop for shard in shards])
        whole = bool((at >= 0).all() and (numbers < stops[at]).all())
    if not whole:
        raise CorruptError(
            f"the catalogue's entries and shards of population {population_id[:12]} do not fit together",
            expected=f"one row for each of the {count} entries in its shards",
            do="run `dynreg verify --repair`",
        )


def _header(path: Path | Remote, shard: Row, record: PopulationRecord) -> dict[str, Any]:
    """The header of a shard's states, which are those of its row in the catalogue; CorruptError else."""
    header = read_states_header(path)
    if [header[key] for key in ("population", "start", "stop")] != [record.id, shard.start, shard.stop]:
        raise not_as_stored(path, "it belongs to another shard")
    if header["states"] != [channel.name for channel in record.channels] or not record.fits(header["shape"]):
        raise not_as_stored(path, "its states are not those of its population")
    return header


def _states(directory: Directory, shards: Sequence[Row], record: PopulationRecord) -> np.ndarray:
    paths = directory.checked(*(shard.states_path for shard in shards))
    headers = [_header(path, shard, record) for path, shard in zip(paths, shards, strict=True)]
    offsets = np.cumsum([0, *(shard.stop - shard.start for shard in shards)])
    out = np.empty((offsets[-1], *headers[0]["shape"][1:]), np.float32)
    with ThreadPoolExecutor(_THREADS) as pool:
        for _ in pool.map(
            lambda i: read_states(paths[i], out[offsets[i] : offsets[i + 1]]), range(len(paths))
        ):
            pass  # draws the errors out
    return out


def _rest(
    path: Path | Remote,
    rows: int,
    record: PopulationRecord,
    skip: str = "/",
    only: Sequence[int] | None = None,
) -> dict[str, np.ndarray]:
    """The arrays of a shard of `rows` entries but its states, or of some `only`; CorruptError where they are not those.

    only : positions in the shard.
    """
    whole = only if isinstance(path, Remote) else None  # of a file here all is looked at
    _, arrays = decode_arrays(path, skip, whole)
    rows = rows if whole is None else len(whole)
    shapes = {"values": (rows, len(record.parameters)), "own_loss": (rows,), "train_loss": (rows,)}
    shapes |= {name: (rows,) for name in arrays if name.startswith("extra/")}
    odd = [name for name, shape in shapes.items() if name not in arrays or arrays[name].shape != shape]
    odd += [
        name for name, array in arrays.items() if array.shape[:1] != (rows,) or array.dtype.kind not in "fiu"
    ]
    if odd:
        raise not_as_stored(path, f"it lacks {odd[0]!r}, or that is not of its {rows} entries")
    return arrays if only is None or whole is not None else {n: a[list(only)] for n, a in arrays.items()}


def _stack(parts: Sequence[dict[str, np.ndarray]], name: str) -> np.ndarray:
    return np.concatenate([part[name] for part in parts])


def _stack_all(parts: Sequence[dict[str, np.ndarray]], prefix: str) -> dict[str, np.ndarray]:
    names = sorted({name for part in parts for name in part if name.startswith(prefix)})
    missing = [np.full(len(part["values"]), np.nan) for part in parts]
    try:
        return {
            name: np.concatenate(
                [part.get(name, absent) for part, absent in zip(parts, missing, strict=True)]
            )
            for name in names
        }
    except ValueError as error:
        raise CorruptError(
            f"the shards of a population have arrays of different shapes: {error}",
            expected="models of one kind",
            do="run `dynreg verify` on the registry",
        ) from error
