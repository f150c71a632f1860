"""What several simulators or one robot did in the same episodes: states with the commands that they were given."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pyarrow as pa

from dynreg.data.recording import Channel
from dynreg.data.transitions import Transitions

KEYS = ("entry", "number", "episode", "step", "time")  # columns that say which row it is


@dataclass(frozen=True)
class Columns:
    """The columns of a robot's rows by role: states (S,), actions (A,), inputs (I,) and settings (K,)."""

    states: tuple[Channel, ...]
    actions: tuple[Channel, ...] = ()
    inputs: tuple[Channel, ...] = ()
    settings: tuple[Channel, ...] = ()

    @property
    def all(self) -> tuple[Channel, ...]:
        """All of them, in the order of their roles."""
        return (*self.states, *self.actions, *self.inputs, *self.settings)

    @property
    def context(self) -> tuple[Channel, ...]:
        """Inputs, then settings: what a model is told besides state and action."""
        return (*self.inputs, *self.settings)

    @property
    def by_role(self) -> dict[str, tuple[Channel, ...]]:
        """The columns by their role, in the order of the roles."""
        return {"state": self.states, "action": self.actions, "input": self.inputs, "setting": self.settings}


@dataclass(frozen=True, eq=False)
class Trajectories:
    """What n entries did in the same E episodes of T steps.

    Attributes
    ----------
    columns : of the arrays below.
    entries : (n,) ids. numbers : (n,) which each one is in its population; None of a recording.
    episodes : (E,) names, or numbers from 0 on.
    time : (n, E, T+1) [s]; None where nobody told it.
    states : (n, E, T+1, S) float32.
    actions : (E, T+1, A) float32, the same for all entries; NaN where no command follows the last state.
    inputs : (E, T+1, I) likewise. settings : (E, K).
    """

    columns: Columns
    entries: tuple[str, ...]
    numbers: np.ndarray | None
    episodes: Sequence[str] | np.ndarray
    time: np.ndarray | None
    states: np.ndarray
    actions: np.ndarray
    inputs: np.ndarray
    settings: np.ndarray

    @cached_property
    def context(self) -> np.ndarray:
        """(E, T+1, I+K) inputs and settings of each row."""
        steps = self.inputs.shape[1]
        return np.concatenate([self.inputs, np.repeat(self.settings[:, None], steps, axis=1)], axis=-1)

    def transitions(self, entries: slice = slice(None), first: int = 0) -> Transitions:
        """The transitions of some entries (n' E T rows), those in which anything is NaN left out.

        first : what `Transitions.entry` numbers the first of all entries here.
        """
        states = self.states[entries]
        n, episodes, rows, _ = states.shape
        shape = (n, episodes, rows - 1)

        def flat(values: np.ndarray, *width: int) -> np.ndarray:
            whole = np.broadcast_to(values, (*shape, *width))
            return np.ascontiguousarray(whole).reshape(n * episodes * (rows - 1), *width)

        number = first + np.arange(len(self.states))[entries]
        time = np.nan if self.time is None else np.diff(self.time[entries], axis=-1)
        found = Transitions(
            flat(states[:, :, :-1], states.shape[-1]),
            flat(self.actions[:, :-1], self.actions.shape[-1]),
            flat(self.context[:, :-1], self.context.shape[-1]),
            flat(states[:, :, 1:], states.shape[-1]),
            flat(np.arange(episodes)[:, None]),
            flat(number[:, None, None]),
            flat(np.asarray(time, np.float32)),
        )
        # a sum that is finite has no NaN in it, and costs no array of flags
        if all(np.isfinite(a.sum()) for a in (states, self.actions[:, :-1], self.context[:, :-1])):
            return found
        told = (found.states, found.actions, found.context, found.next_states)
        return found.take(np.logical_and.reduce([np.isfinite(column).all(axis=-1) for column in told]))

    def split(self, rows: int) -> Iterator["Trajectories"]:
        """The same for some entries at a time: about `rows` states, at least one entry."""
        together = max(rows // max(self.states.shape[1] * self.states.shape[2], 1), 1)
        for first in range(0, len(self.entries), together):
            some = slice(first, first + together)
            yield replace(
                self,
                entries=self.entries[some],
                numbers=None if self.numbers is None else self.numbers[some],
                time=None if self.time is None else self.time[some],
                states=self.states[some],
            )

    def table(self) -> pa.Table:
        """A row for each state: the keys, then states, actions, inputs and settings by name.

        A field's metadata tells its role and unit. Where no command follows there is a null.
        """
        n, episodes, steps, _ = self.states.shape
        rows = episodes * steps
        columns = list(self._keys(n, episodes, steps))
        states = np.ascontiguousarray(self.states.reshape(n * rows, -1).T)
        columns += [("state", c, numbers(v)) for c, v in zip(self.columns.states, states, strict=True)]
        settings = np.repeat(self.settings[:, None], steps, axis=1)
        told = {"action": self.actions, "input": self.inputs, "setting": settings}
        for role, values in told.items():
            columns += [
                (role, c, _repeated(np.ascontiguousarray(values[..., i]).ravel(), n))
                for i, c in enumerate(self.columns.by_role[role])
            ]
        fields = [
            pa.field(c.name, array.type, metadata={"role": role} | ({"unit": c.unit} if c.unit else {}))
            for role, c, array in columns
        ]
        return pa.Table.from_arrays([array for _, _, array in columns], schema=pa.schema(fields))

    def _keys(self, n: int, episodes: int, steps: int) -> Iterator[tuple[str, Channel, pa.Array]]:
        rows = episodes * steps
        yield "key", Channel("entry", ""), texts(self.entries, np.repeat(np.arange(n, dtype=np.int32), rows))
        if self.numbers is not None:
            yield "key", Channel("number", ""), numbers(np.repeat(self.numbers.astype(np.int32), rows))
        at = np.tile(np.repeat(np.arange(episodes, dtype=np.int32), steps), n)
        named = not isinstance(self.episodes, np.ndarray)
        told = texts(self.episodes, at) if named else numbers(_small(self.episodes)[at])
        yield "key", Channel("episode", ""), told
        yield "key", Channel("step", ""), numbers(np.tile(_small(np.arange(steps)), n * episodes))
        if self.time is not None:
            yield "key", Channel("time", "s"), numbers(np.ascontiguousarray(self.time, np.float64).ravel())


def _small(whole: np.ndarray) -> np.ndarray:
    """Numbers from 0 on, in 16 bits where they fit and else in 32: stored shards keep their bytes."""
    return whole.astype(np.int16 if whole.max(initial=0) <= np.iinfo(np.int16).max else np.int32)


def numbers(values: np.ndarray) -> pa.Array:
    """An Arrow array over a contiguous numpy array (N,)."""
    # pa.array() would load pandas to see whether it was given some of it.
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, pa.py_buffer(values)])


def texts(names: Sequence[str], at: np.ndarray) -> pa.DictionaryArray:
    """An Arrow array (N,) of names by their numbers `at` (N,)."""
    return pa.DictionaryArray.from_arrays(numbers(at), pa.array(list(names), pa.string()))


def _repeated(values: np.ndarray, n: int) -> pa.Array:
    """(n N,) values (N,) again and again, NaN as null."""
    flat = np.tile(values, n)
    there = ~np.isnan(flat)
    if there.all():
        return numbers(flat)
    valid = pa.py_buffer(np.packbits(there, bitorder="little"))
    return pa.Array.from_buffers(
        pa.float32(), len(flat), [valid, pa.py_buffer(np.where(there, flat, np.float32(0.0)))]
    )
