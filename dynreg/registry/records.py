"""The nouns of the registry: what goes in and what comes out, all frozen."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynreg.data.recording import Channel
from dynreg.data.trajectories import KEYS, Columns, Trajectories
from dynreg.errors import RegistryError
from dynreg.registry.shapes import AXES, bank_shape, fits_bank
from dynreg.registry.tables import MOST_ENTRIES

_ID = re.compile(r"[0-9a-f]{16,}")
COMMANDED = tuple(AXES)  # what all entries of a population are told alike


@dataclass(frozen=True)
class PopulationRecord:
    """Everything that the entries of one population share.

    Attributes
    ----------
    id : the population's content hash, which does not depend on `size`.
    robot_hash : id of a robot that the registry holds.
    name : for people.
    channels : (S,) state channels with their units, in the order of `ShardData.states`.
    parameters : (P,) parameter names, in the order of `ShardData.values`.
    size : planned number of entries; may grow.
    shard_size : entries in a full shard.
    seed : root of every random draw.
    spec : JSON data: ranges, excitation, training settings.
    arrays : excitation actions, normaliser, base model weights, by name. What every entry executes is among them:
        `bank.actions` (E, T, A), `bank.inputs` (E, T, I) and `bank.settings` (E, K).
    actions, inputs, settings : their columns with their units. parameter_units : (P,). None of these is told in
        populations that came before they were kept and whose robot does not tell them.
    """

    id: str
    robot_hash: str
    name: str
    channels: tuple[Channel, ...]
    parameters: tuple[str, ...]
    size: int
    seed: int
    spec: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    shard_size: int = 200
    actions: tuple[Channel, ...] = ()
    inputs: tuple[Channel, ...] = ()
    settings: tuple[Channel, ...] = ()
    parameter_units: tuple[str, ...] = ()

    def __post_init__(self):
        for name in ("channels", "parameters", *COMMANDED, "parameter_units"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        names = [column.name for column in self.columns.all]
        if not _ID.fullmatch(self.id) or len({*names, *KEYS}) < len(names) + len(KEYS):
            raise RegistryError(
                f"population {self.id!r} with the columns {names}",
                expected=f"16 or more hexadecimal digits; unique columns, none named {', '.join(KEYS)}",
                do="give its content hash as the id, and rename the channel or setting",
            )
        if not 1 <= self.size <= MOST_ENTRIES or self.shard_size < 1:
            raise RegistryError(
                f"population {self.name!r} of {self.size} entries in shards of {self.shard_size}",
                expected=f"1 to {MOST_ENTRIES} entries in shards of at least one",
                do="ask for a population of so many entries",
            )
        units = len(self.parameter_units) in (0, len(self.parameters))
        try:
            if not units or len(set(self.parameters)) < len(self.parameters):
                raise ValueError(f"{len(self.parameter_units)} units of the parameters {self.parameters}")
            bank_shape(self.arrays, {group: getattr(self, group) for group in COMMANDED})
        except ValueError as error:
            raise RegistryError(
                f"population {self.name!r}: {error}",
                expected="a unit for each parameter; bank arrays (E, T, columns), settings (E, columns)",
                do="give one column for each channel, and the same episodes and steps in all",
            ) from error

    def fits(self, shape: Sequence[int]) -> bool:
        """Whether states of a shape (n, E, T+1, S) are of its channels, and of the episodes and steps of its bank."""
        bank = bank_shape(self.arrays, {group: getattr(self, group) for group in COMMANDED})
        return shape[3] == len(self.channels) and fits_bank(bank, shape)

    @property
    def units(self) -> dict[str, str]:
        """{parameter: its unit}, "" where nobody told it."""
        return dict(zip(self.parameters, self.parameter_units or ("",) * len(self.parameters), strict=True))

    @property
    def columns(self) -> Columns:
        """The columns of a shard's rows; those that are not told are left out."""
        return Columns(self.channels, self.actions, self.inputs, self.settings)

    def trajectories(
        self,
        entries: Sequence[str],
        numbers: np.ndarray,
        states: np.ndarray,
        periods: np.ndarray | None,
    ) -> Trajectories:
        """What entries (n,) did: states (n, E, T+1, S), a period (n, E) [s] apart, under the commands of all."""
        episodes, rows = states.shape[1:3]
        if not self.fits(states.shape):
            raise RegistryError(
                f"states of shape {states.shape} in population {self.id[:12]}",
                expected="the channels of the population, and the episodes and steps of its bank",
                do="compute the entries with the population's settings",
            )

        def told(group: str, shape: tuple[int, ...]) -> np.ndarray:
            count = len(getattr(self, group))
            out = np.full((*shape, count), np.nan, np.float32)
            if count:  # no command follows the last state
                values = self.arrays[f"bank.{group}"]
                out[tuple(slice(size) for size in values.shape[:-1])] = values
            return out

        return Trajectories(
            columns=self.columns,
            entries=tuple(entries),
            numbers=numbers,
            episodes=np.arange(episodes),
            time=None if periods is None else periods[..., None] * np.arange(rows),
            states=states,
            actions=told("actions", (episodes, rows)),
            inputs=told("inputs", (episodes, rows)),
            settings=told("settings", (episodes,)),
        )


@dataclass(frozen=True)
class ShardData:
    """A run of consecutive entries of one population, stacked along the first axis.

    Attributes
    ----------
    values : (n, P) float64, parameter values in their units.
    states : (n, E, T+1, S) float32, E episodes of T transitions.
    weights : model weights by name, each (n, ...), float16 as a rule.
    own_loss : (n,) held-out loss of each model on its own simulator's data.
    train_loss : (n,) loss at the end of training.
    extra : further figures by name, each (n,).
    periods : (n, E) seconds from a row to the next; None where nobody told them.
    """

    values: np.ndarray
    states: np.ndarray
    weights: Mapping[str, np.ndarray]
    own_loss: np.ndarray
    train_loss: np.ndarray
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    periods: np.ndarray | None = None

    def __post_init__(self):
        set_ = object.__setattr__
        set_(self, "values", np.ascontiguousarray(self.values, dtype=np.float64))
        set_(self, "states", np.ascontiguousarray(self.states, dtype=np.float32))
        set_(self, "weights", {k: np.ascontiguousarray(v) for k, v in sorted(self.weights.items())})
        for name in ("own_loss", "train_loss"):
            set_(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        set_(self, "extra", {k: np.asarray(v, dtype=np.float64) for k, v in sorted(self.extra.items())})
        if self.periods is not None:
            set_(self, "periods", np.ascontiguousarray(self.periods, dtype=np.float64))
        self._check()

    def __len__(self) -> int:
        return len(self.values)

    def slice(self, start: int, stop: int) -> "ShardData":
        """Entries `start` to `stop` (positions in this shard)."""
        return ShardData(
            self.values[start:stop],
            self.states[start:stop],
            {name: array[start:stop] for name, array in self.weights.items()},
            self.own_loss[start:stop],
            self.train_loss[start:stop],
            {name: array[start:stop] for name, array in self.extra.items()},
            None if self.periods is None else self.periods[start:stop],
        )

    @property
    def layout(self) -> dict[str, Any]:
        """Shapes of one entry, which all entries of a population share."""
        weights = {name: [list(array.shape[1:]), str(array.dtype)] for name, array in self.weights.items()}
        return {"states": list(self.states.shape[1:]), "weights": weights}

    def entry_id(self, population_id: str, position: int) -> str:
        """Content hash of one entry: its population, values, states and weights, not its losses."""
        digest = hashlib.sha256(population_id.encode())
        digest.update(self.values[position].tobytes())
        digest.update(str(self.states.shape[1:]).encode())
        digest.update(self.states[position].data)
        for name, array in self.weights.items():
            digest.update(f"{name}{array.dtype}{array.shape[1:]}".encode())
            digest.update(array[position].tobytes())
        return digest.hexdigest()

    def entry_ids(self, population_id: str) -> tuple[str, ...]:
        """Content hashes of all entries, in order."""
        return tuple(self.entry_id(population_id, i) for i in range(len(self)))

    def _check(self) -> None:
        count = len(self.values)
        lengths = {"states": self.states, "own_loss": self.own_loss, "train_loss": self.train_loss}
        lengths |= {f"weights {k!r}": v for k, v in self.weights.items()}
        lengths |= {f"extra {k!r}": v for k, v in self.extra.items()}
        wrong = [f"{name} {array.shape}" for name, array in lengths.items() if array.shape[:1] != (count,)]
        if self.periods is not None and self.periods.shape != self.states.shape[:2]:
            wrong.append(f"periods {self.periods.shape}")
        elif self.periods is not None and not (np.isfinite(self.periods) & (self.periods > 0)).all():
            wrong.append("periods that are not finite and above 0")
        if wrong or count == 0 or self.values.ndim != 2 or self.states.ndim != 4:
            raise RegistryError(
                f"a shard with values {self.values.shape}, states {self.states.shape} {' '.join(wrong)}",
                expected="values (n, P), states (n, E, T+1, S) and n > 0 rows in every other array",
                do="stack one row for each entry",
            )


@dataclass(frozen=True)
class PopulationArrays:
    """The entries of a population, stacked in the order of their numbers.

    `ids` (N,) content hashes; `numbers` (N,) index in the population; `parameters` (P,) names of the
    columns of `values` (N, P); `states` (N, E, T+1, S) float32 and `weights` (N, ...) by name, both None
    where they were not asked for; `own_loss`, `train_loss` (N,); `extra` by name, (N,), NaN where missing.
    """

    ids: tuple[str, ...]
    numbers: np.ndarray
    parameters: tuple[str, ...]
    values: np.ndarray
    states: np.ndarray | None
    weights: dict[str, np.ndarray] | None
    own_loss: np.ndarray
    train_loss: np.ndarray
    extra: dict[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class EntryRecord:
    """One entry: `values` by parameter name, `states` (E, T+1, S), `weights` by name, `periods` (E,) or None."""

    id: str
    population_id: str
    number: int
    values: dict[str, float]
    states: np.ndarray
    weights: dict[str, np.ndarray]
    own_loss: float
    train_loss: float
    extra: dict[str, float]
    periods: np.ndarray | None = None

    def as_shard(self) -> ShardData:
        """The entry as a shard of one."""
        return ShardData(
            np.array([list(self.values.values())]),
            self.states[None],
            {name: array[None] for name, array in self.weights.items()},
            np.array([self.own_loss]),
            np.array([self.train_loss]),
            {name: np.array([value]) for name, value in self.extra.items()},
            None if self.periods is None else self.periods[None],
        )


@dataclass(frozen=True)
class MeasuredEntry:
    """The model of a recording in a population: trained as the models of its entries, on what was measured.

    weights : by name. own_loss : on held-out rows of the recording; train_loss on the others.
    """

    population_id: str
    recording_id: str
    weights: Mapping[str, np.ndarray]
    own_loss: float
    train_loss: float

    @property
    def id(self) -> str:
        """Content hash over the population, the recording and the weights."""
        digest = hashlib.sha256(f"measured {self.population_id} {self.recording_id}".encode())
        for name, array in sorted(self.weights.items()):
            digest.update(f"{name}{array.dtype}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()
