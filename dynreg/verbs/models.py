"""The trained models of entries, and how far entries are from each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dynreg.distance.cross_loss import JUDGED_ON
from dynreg.distance.population import Shared
from dynreg.distance.rows import thin
from dynreg.errors import UsageError
from dynreg.index import search
from dynreg.models.dynamics import DynamicsModel
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack, stack_of
from dynreg.registry import PopulationRecord, Registry
from dynreg.rng import stream
from dynreg.verbs.measured import each_sound, model_of, rows_of
from dynreg.verbs.populations import load_population, shared_of
from dynreg.verbs.simulators import told_last
from dynreg.verbs.subjects import require_models

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("entry", "measured", "population")


def dynamics_model(registry: Registry, refs: str | Sequence[str]) -> DynamicsModel:
    """The models of entries, in the order of `refs`, or of all simulators of a population, by number.

    A single id of an entry, also of a recording's, gives one model alone. Raises NoMatchError for a ref that fits
    nothing, UsageError for entries of several populations, whose models do not take the same rows, and for those of
    populations of effects, which have no models.
    """
    named = [refs] if isinstance(refs, str) else list(refs)
    found = [registry.resolve(told_last(registry, ref), KINDS) for ref in named]
    populations = {record.id: record for record in (_population_of(registry, *one) for one in found)}
    if len(populations) != 1 or len(set(found)) != len(found):
        raise UsageError(
            f"models of {len(found)} things of {len(populations)} populations",
            expected="entries of one population, each once, or one population",
            do="ask for each population by itself",
        )
    (record,) = populations.values()
    stacks, entries = [], []
    held = registry.load(record.id, ("weights",)) if any(kind != "measured" for kind, _ in found) else None
    whole = None if held is None else MlpStack.from_arrays(held.weights)
    for kind, identity in found:
        if kind == "measured":
            stacks.append(model_of(registry, identity))
            entries.append(identity)
        else:
            rows = range(len(held)) if kind == "population" else [held.ids.index(identity)]
            stacks.append(whole[np.array(rows)])
            entries += [held.ids[i] for i in rows]
    shared = shared_of(registry, record)
    robot = shared.robot
    return DynamicsModel(
        entries=tuple(entries),
        alone=isinstance(refs, str) and found[0][0] != "population",
        stack=stack_of(stacks),
        normaliser=shared.normaliser,
        states=robot.channels,
        actions=robot.actions,
        context=(*robot.inputs, *robot.settings),
        usual=robot.context_defaults,
    )


def near_entries(registry: Registry, ref: str, k: int) -> "pd.DataFrame":
    """The k entries nearest to an entry by cross-loss: simulators by a walk over the graph, recordings all looked at.

    Columns: id, kind ("entry" or "measured"), name, distance. Raises UsageError where the population is not linked,
    NoMatchError where there is no such entry.
    """
    import pandas as pd

    if k < 1:
        raise UsageError(f"k = {k}", expected="at least 1", do="ask for one neighbour or more")
    kind, identity = registry.resolve(told_last(registry, ref), ("entry", "measured"))
    record = _population_of(registry, kind, identity)
    population = load_population(registry, record.id, judged=True)
    if population.graph is None:
        raise UsageError(
            f"population {record.id[:12]} is not linked",
            expected="a graph over its entries",
            do="run `dynreg populate` again without --no-link",
        )
    own = _judged(registry, population.shared, kind, identity)
    to = population.cross_loss.query(own.model, own.inputs, own.targets, own.loss)
    count = min(k + 1, len(population))
    found = search(population.graph, to, count, stream(record.seed, "neighbours"), ef=max(2 * count, 30))
    ids, numbers = population.entries.ids, population.entries.numbers
    rows = [
        (float(d), ids[i], "entry", f"{record.name}-{numbers[i]}")
        for i, d in zip(found.ids.tolist(), found.distances, strict=True)
    ]
    held = registry.measured_in(record.id)
    for recording, entry, other in each_sound(
        held, lambda entry: _judged(registry, population.shared, "measured", entry)
    ):
        rows.append((_apart(own, other), entry, "measured", registry.recording_info(recording).name))
    near = sorted(row for row in rows if row[1] != identity)[:k]
    return pd.DataFrame(
        [(i, kind, name, d) for d, i, kind, name in near], columns=["id", "kind", "name", "distance"]
    )


def entry_distance(registry: Registry, a: str, b: str) -> float:
    """The cross-loss distance of two entries of a population: 1 for the same, larger for others (paper D)."""
    found = [registry.resolve(told_last(registry, ref), ("entry", "measured")) for ref in (a, b)]
    first, second = (_population_of(registry, *one) for one in found)
    if first.id != second.id:
        raise UsageError(
            f"entries of populations {first.id[:12]} and {second.id[:12]}",
            expected="two entries of one population: distances exist only inside one",
            do="see `dynreg show ID` for an entry's population",
        )
    shared = shared_of(registry, first)
    return _apart(*(_judged(registry, shared, *one) for one in found))


@dataclass(frozen=True, eq=False)
class _Judged:
    """An entry as cross-loss sees it: its model (1), rows (N, D), (N, S) that judge others, and its loss on them."""

    model: MlpStack
    inputs: np.ndarray
    targets: np.ndarray

    @property
    def loss(self) -> float:
        return self.on(self)

    def on(self, other: "_Judged") -> float:
        """The loss of its model on the rows of another."""
        return float(losses(self.model, other.inputs, other.targets)[0])


def _judged(registry: Registry, shared: Shared, kind: str, identity: str) -> _Judged:
    if kind == "measured":
        entry = registry.measured(identity)
        model = model_of(registry, identity)
        inputs, targets = rows_of(shared, registry.recording(entry.recording_id)).held
    else:
        entry = registry.load_entry(identity)
        model = MlpStack.from_arrays({name: array[None] for name, array in entry.weights.items()})
        inputs, targets = (rows[0] for rows in shared.rows(entry.states[None]).held)
    some = thin(len(inputs), JUDGED_ON, shared.seed, "judged")
    return _Judged(model, inputs[some], targets[some])


def _apart(a: _Judged, b: _Judged) -> float:
    return (a.on(b) + b.on(a)) / (a.loss + b.loss)


def _population_of(registry: Registry, kind: str, identity: str) -> PopulationRecord:
    """The population of a thing; UsageError for one of effects, which has no models."""
    if kind == "entry":
        identity = registry.entry(identity)[0]
    elif kind == "measured":
        identity = registry.measured(identity).population_id
    record = registry.population(identity)
    require_models(record)
    return record
