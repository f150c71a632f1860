"""A dataset: transitions of simulators and of real robots over the same columns, read part by part."""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pyarrow as pa

from dynreg.data.trajectories import Columns, Trajectories
from dynreg.data.transitions import Transitions, joined
from dynreg.datasets.measured import RecordingPart
from dynreg.errors import UsageError
from dynreg.models.normaliser import Normaliser
from dynreg.rng import stream

if TYPE_CHECKING:
    import pandas as pd

    from dynreg.datasets.torch_dataset import TorchDataset

ROWS = 4096  # transitions in a batch
AHEAD = 2  # parts that are read while one is used
GROUP = 65536  # states in a batch of Arrow: few enough that a big shard is not copied as a whole


class Part(Protocol):
    """What is read at once, such as a shard. Parts can be sent to other processes.

    entries : ids. rows : states. count : transitions. periods : (episodes,) seconds from a state to the next, NaN where
    nobody told them.
    """

    @property
    def entries(self) -> Sequence[str]: ...

    @property
    def rows(self) -> int: ...

    @property
    def count(self) -> int: ...

    @property
    def periods(self) -> np.ndarray: ...

    def read(self) -> Sequence[Trajectories]:
        """All of it; CorruptError where its file is lost or damaged."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """Transitions (state, action, context, next state) of entries, by population and number, and of recordings.

    Nothing is read before it is asked for, and then one part at a time, with the next one read ahead.

    Attributes
    ----------
    robot : its name.
    columns : names and units of states (S,), actions (A,), inputs and settings; the last two are the context (K,).
    parts : where the rows are.
    normaliser : that of the population of its entries; None where they are of none, or of several.
    firsts : the number in `entries` of the first one of each part.
    """

    robot: str
    columns: Columns
    parts: tuple[Part, ...]
    normaliser: Normaliser | None = None
    firsts: tuple[int, ...] = ()

    def __post_init__(self):
        if not self.firsts:
            counts = np.cumsum([0, *(len(part.entries) for part in self.parts)])
            object.__setattr__(self, "firsts", tuple(counts[:-1].tolist()))

    def __len__(self) -> int:
        return sum(part.count for part in self.parts)

    @property
    def entries(self) -> tuple[str, ...]:
        """Ids of the entries and recordings, in order."""
        return tuple(entry for part in self.parts for entry in part.entries)

    @property
    def periods(self) -> np.ndarray:
        """Seconds from a state to the next in each episode of each entry (episodes,), NaN where nobody told them."""
        return np.concatenate([part.periods for part in self.parts])

    @property
    def uneven(self) -> tuple[str, ...]:
        """Names of the episodes whose rows follow each other after different times; entries have none."""
        return tuple(name for p in self.parts if isinstance(p, RecordingPart) for name in p.uneven)

    def __repr__(self) -> str:
        c = self.columns
        sizes = f"{len(c.states)} states, {len(c.actions)} actions, {len(c.context)} of context"
        entries = sum(len(part.entries) for part in self.parts if not isinstance(part, RecordingPart))
        counted = [(entries, "entry", "entries"), (len(self.entries) - entries, "recording", "recordings")]
        told = " and ".join(f"{n} {one if n == 1 else several}" for n, one, several in counted if n)
        return f"<Dataset of {self.robot}: {told}, {len(self)} transitions, {sizes}>"

    def of_parts(self, numbers: Sequence[int] | np.ndarray | slice) -> "Dataset":
        """Only these parts, in this order; the rows keep the numbers of their entries."""
        some = np.arange(len(self.parts))[numbers]
        firsts = tuple(self.firsts[i] for i in some)
        return replace(self, parts=tuple(self.parts[i] for i in some), firsts=firsts)

    def trajectories(self) -> Iterator[Trajectories]:
        """What they did, part by part; the next part is read while this one is used."""
        return (trajectories for _, part in self._read() for trajectories in part)

    def _read(self) -> Iterator[tuple[int, Sequence[Trajectories]]]:
        """The number of the first entry of each part, and what is in it."""
        with ThreadPoolExecutor(AHEAD) as pool:
            waiting: deque[tuple[int, Future]] = deque()
            for first, part in zip(self.firsts, self.parts, strict=True):
                waiting.append((first, pool.submit(part.read)))
                if len(waiting) > AHEAD:
                    begin, ready = waiting.popleft()
                    yield begin, ready.result()
            while waiting:
                begin, ready = waiting.popleft()
                yield begin, ready.result()

    def batches(self, rows: int = ROWS, *, seed: int | None = None) -> Iterator[Transitions]:
        """Transitions, about `rows` at a time (whole entries of a part where they are shorter).

        seed : draws an order of the parts and, within each, of its transitions; None keeps theirs.
        """
        check_rows(rows)
        return (
            self._in_order(rows) if seed is None else self._shuffled(rows, stream(seed, "dataset", "order"))
        )

    def _in_order(self, rows: int) -> Iterator[Transitions]:
        for begin, part in self._read():
            for one in part:
                each = one.states.shape[1] * (one.states.shape[2] - 1)
                together = max(rows // max(each, 1), 1)
                for first in range(0, len(one.entries), together):
                    found = one.transitions(slice(first, first + together), begin)
                    for at in range(0, len(found), rows):
                        yield found if len(found) <= rows else found.take(slice(at, at + rows))

    def _shuffled(self, rows: int, rng: np.random.Generator) -> Iterator[Transitions]:
        for begin, part in self.of_parts(rng.permutation(len(self.parts)))._read():
            found = joined([one.transitions(first=begin) for one in part])
            at = rng.permutation(len(found))
            for first in range(0, len(found), rows):
                yield found.take(at[first : first + rows])

    def to_numpy(self) -> Transitions:
        """All transitions: states and next_states (N, S), actions (N, A), context (N, K); episode, entry, period (N,).

        entry : which of `entries` a row is of. period : [s] to the next state.
        """
        c, total = self.columns, len(self)
        shapes = {"states": len(c.states), "actions": len(c.actions), "context": len(c.context)}
        out = {name: np.empty((total, width), np.float32) for name, width in shapes.items()}
        out["next_states"], out["period"] = np.empty_like(out["states"]), np.empty(total, np.float32)
        out |= {name: np.empty(total, np.int64) for name in ("episode", "entry")}
        at = 0
        for batch in self.batches():
            for name, array in out.items():
                array[at : at + len(batch)] = getattr(batch, name)
            at += len(batch)
        return Transitions(**{name: array[:at] for name, array in out.items()})

    def to_arrow(self) -> pa.RecordBatchReader:
        """Its rows as a stream of Arrow batches, a state in each row; `read_all()` makes a table.

        Columns: entry, number (null of a recording), episode (its name), step, time [s], then states, actions, inputs
        and settings by name, float32. A field's metadata tells its unit and role.
        """
        schema = arrow_schema(self.columns)

        def batches() -> Iterator[pa.RecordBatch]:
            for one in self.trajectories():
                for some in one.split(GROUP):
                    yield from _as(schema, some.table()).to_batches()

        return pa.RecordBatchReader.from_batches(schema, batches())

    def to_frame(self) -> "pd.DataFrame":
        """Its rows as a pandas DataFrame, with the columns of `to_arrow`."""
        return self.to_arrow().read_pandas()

    def to_torch(self, rows: int = ROWS, *, seed: int | None = None) -> "TorchDataset":
        """A torch `IterableDataset` of batches; give it to `DataLoader(..., batch_size=None)`. See `TorchDataset`."""
        from dynreg.datasets.torch_dataset import TorchDataset

        check_rows(rows)
        return TorchDataset(self, rows, seed)


def check_rows(rows: int) -> None:
    """UsageError for what cannot be the size of a batch."""
    if not isinstance(rows, int | np.integer) or isinstance(rows, bool) or rows < 1:
        raise UsageError(
            f"batches of {rows!r} rows", expected="a whole number of at least 1", do="give another `rows`"
        )


def arrow_schema(columns: Columns) -> pa.Schema:
    """The schema of `Dataset.to_arrow`."""
    text, keys = pa.dictionary(pa.int32(), pa.string()), {"role": "key"}
    fields = [pa.field("entry", text, metadata=keys), pa.field("number", pa.int32(), metadata=keys)]
    fields += [pa.field("episode", text, metadata=keys), pa.field("step", pa.int32(), metadata=keys)]
    fields.append(pa.field("time", pa.float64(), metadata=keys | {"unit": "s"}))
    fields += [
        pa.field(c.name, pa.float32(), metadata={"role": role, "unit": c.unit})
        for role, named in columns.by_role.items()
        for c in named
    ]
    return pa.schema(fields)


def _as(schema: pa.Schema, table: pa.Table) -> pa.Table:
    """A table of trajectories with the columns of a schema; those that it lacks are null."""
    columns = []
    for field in schema:
        if field.name not in table.column_names:
            columns.append(pa.nulls(len(table), field.type))
        elif pa.types.is_dictionary(field.type) and not pa.types.is_dictionary(table[field.name].type):
            columns.append(table[field.name].cast(pa.string()).dictionary_encode())
        else:
            columns.append(table[field.name].cast(field.type))
    return pa.Table.from_arrays(columns, schema=schema)
