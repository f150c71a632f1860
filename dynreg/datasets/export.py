"""What is exported: a dataset, with what is known of its entries and recordings."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from dynreg.data.recording import Channel, Recording
from dynreg.data.trajectories import Columns
from dynreg.datasets.dataset import Dataset


@dataclass(frozen=True, eq=False)
class Simulated:
    """Entries of one population.

    Attributes
    ----------
    population : its id. spec : plain JSON: ranges, excitation, training.
    columns : of its entries. parameters : (P,) with their units.
    entries : (n,) ids. numbers : (n,). values : (n, P) in those units. own_loss, train_loss : (n,).
    engine : what simulated them. timestep : its physics time step [s].
    held_out_every : one episode in so many was held out from the training of the models, the last of them.
    usual : nominal inputs and settings, in the order of `columns.context`.
    weights : reads those of the models by name, each (n', ...), some entries at a time and in order.
    """

    population: str
    spec: Mapping[str, Any]
    columns: Columns
    parameters: tuple[Channel, ...]
    entries: tuple[str, ...]
    numbers: np.ndarray
    values: np.ndarray
    own_loss: np.ndarray
    train_loss: np.ndarray
    engine: str
    timestep: float
    held_out_every: int
    usual: np.ndarray
    weights: Callable[[], Iterator[Mapping[str, np.ndarray]]]


@dataclass(frozen=True, eq=False)
class Recorded:
    """One recording: its id and name, whether it was measured, the names of its log files, and how to read it."""

    id: str
    name: str
    measured: bool
    files: tuple[str, ...]
    read: Callable[[], Recording]


@dataclass(frozen=True, eq=False)
class Measured:
    """The entry of a recording in a population: its id, that population, its own loss, and its model's weights by name.

    columns, usual : as those of `Simulated`.
    """

    id: str
    population: str
    columns: Columns
    usual: np.ndarray
    own_loss: float
    weights: Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Export:
    """A dataset, where its rows come from, and what a card tells of it.

    Attributes
    ----------
    dataset : the rows, simulated ones first.
    measured : entries of recordings whose models were asked for; their rows are those of the recordings.
    robots : hashes of the robot's versions. licence : None where nobody stated one.
    versions : of dynreg and of what it simulates and trains with, by name.
    """

    dataset: Dataset
    robots: tuple[str, ...]
    populations: tuple[Simulated, ...]
    recordings: tuple[Recorded, ...]
    measured: tuple[Measured, ...]
    licence: str | None
    versions: Mapping[str, str]

    @property
    def count(self) -> int:
        """How many entries and recordings."""
        return len(self.dataset.entries)

    @property
    def is_log(self) -> bool:
        """Whether it is one recording and nothing else."""
        return not self.populations and self.count == 1

    @property
    def models(self) -> int:
        """How many models: of simulated entries, and of those of recordings that were asked for."""
        return sum(len(p.entries) for p in self.populations) + len(self.measured)

    @property
    def episodes(self) -> int:
        """How many episodes, of all entries and recordings."""
        return len(self.dataset.periods)

    @property
    def about(self) -> dict[str, Any]:
        """Plain JSON: the robot, the populations with their spec, and the recordings."""
        return {
            "robot": {"name": self.dataset.robot, "hashes": list(self.robots)},
            "populations": [
                {
                    "id": p.population,
                    "spec": dict(p.spec),
                    "parameters": [[c.name, c.unit] for c in p.parameters],
                }
                for p in self.populations
            ],
            "recordings": [{"id": r.id, "name": r.name, "files": list(r.files)} for r in self.recordings],
            "versions": dict(self.versions),
        }

    def table(self) -> pa.Table:
        """A row for each entry and recording: id, kind, number, population, parameters by name, own_loss, train_loss.

        A parameter's unit is in the metadata of its field. What a recording has not is null.
        """
        rows = [row for p in self.populations for row in _rows(p)]
        rows += [{"id": r.id, "kind": "measured" if r.measured else "simulated"} for r in self.recordings]
        return self._table(rows)

    def models_table(self) -> pa.Table:
        """A row for each model, with the columns of `table`: simulated entries, then those of recordings."""
        rows = [row for p in self.populations for row in _rows(p)]
        rows += [
            {"id": m.id, "kind": "measured", "population": m.population, "own_loss": m.own_loss}
            for m in self.measured
        ]
        return self._table(rows)

    def _table(self, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
        named = {c.name: c for p in self.populations for c in p.parameters}
        keys = {"id": pa.string(), "kind": pa.string(), "number": pa.int32(), "population": pa.string()}
        fields = [pa.field(name, kind) for name, kind in keys.items()]
        fields += [pa.field(n, pa.float64(), metadata={"unit": c.unit}) for n, c in named.items()]
        fields += [pa.field(name, pa.float64()) for name in ("own_loss", "train_loss")]
        return pa.Table.from_pylist(rows, pa.schema(fields))


def _rows(told: Simulated) -> Iterator[dict[str, Any]]:
    names = [c.name for c in told.parameters]
    for i, identity in enumerate(told.entries):
        yield {
            "id": identity,
            "kind": "simulated",
            "number": int(told.numbers[i]),
            "population": told.population,
            **dict(zip(names, told.values[i].tolist(), strict=True)),
            "own_loss": float(told.own_loss[i]),
            "train_loss": float(told.train_loss[i]),
        }
