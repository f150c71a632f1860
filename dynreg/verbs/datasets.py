"""Datasets of stored things: which rows they are, and what they share."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynreg.datasets.dataset import Dataset, Part
from dynreg.datasets.measured import RecordingPart
from dynreg.errors import UsageError
from dynreg.models.normaliser import Normaliser
from dynreg.registry import PopulationRecord, Registry
from dynreg.verbs.populations import columns_of
from dynreg.verbs.simulators import told_last
from dynreg.verbs.subjects import require_models, robot_of

if TYPE_CHECKING:
    import pandas as pd

    from dynreg.sim.robot import Robot


KINDS = ("population", "entry", "measured", "recording")


def dataset(registry: Registry, refs: Sequence[str]) -> Dataset:
    """The rows of entries, populations and recordings, by id, prefix, name or `@last`.

    Entries come by population and number, each once; recordings after them by id, in the robot's columns. The entry of
    a recording means that recording. Raises NoMatchError for a ref that fits nothing, UsageError for none, for
    things of robots with other columns and for populations of effects.
    """
    if not refs:
        raise UsageError("a dataset of nothing", expected="at least one id", do="see `dynreg list`")
    wanted, recordings, others = _wanted(registry, refs)
    records = [registry.population(identity) for identity in sorted(wanted)]
    for record in records:
        require_models(record)  # the rows would lack the effects
    parts: list[Part] = [part for r in records for part in registry.parts(r.id, wanted[r.id])]
    robots = [robot_of(registry, identity, ref) for identity, ref in recordings.items()]
    told = [r.columns for r in records] + [columns_of(robot) for robot in robots]
    names = sorted({*(r.name for r in records), *(robot.name for robot in robots)})
    if len(names) > 1 or any(columns != told[0] for columns in told):
        raise UsageError(
            f"one dataset of {' and '.join(names) if len(names) > 1 else f'versions of {names[0]}'}",
            expected="things with the same columns",
            do="make a dataset of each robot",
        )
    parts += [
        _measured(registry, identity, robot) for identity, robot in zip(recordings, robots, strict=True)
    ]
    shared = [*records, *(registry.population(one) for one in sorted(others - set(wanted)))]
    return Dataset(names[0], told[0], tuple(parts), _normaliser(shared))


def _wanted(
    registry: Registry, refs: Sequence[str]
) -> tuple[dict[str, set[str] | None], dict[str, str], set[str]]:
    """Ids of entries by population (None for all), words for recordings, and populations of recordings' entries."""
    wanted: dict[str, set[str] | None] = {}
    recordings: dict[str, str] = {}
    others: set[str] = set()
    for ref in refs:
        kind, identity = registry.resolve(told_last(registry, ref), KINDS)
        if kind == "population":
            wanted[identity] = None
        elif kind == "entry":
            population, _ = registry.entry(identity)
            held = wanted.setdefault(population, set())
            if held is not None:
                held.add(identity)
        elif kind == "measured":
            entry = registry.measured(identity)
            recordings[entry.recording_id] = entry.recording_id
            others.add(entry.population_id)
        else:
            recordings[identity] = ref
    return wanted, dict(sorted(recordings.items())), others


def _measured(registry: Registry, identity: str, robot: "Robot") -> RecordingPart:
    inputs = dict(zip(robot.inputs, robot.input_defaults.tolist(), strict=True))
    settings = {setting.name: setting.nominal for setting in robot.file.settings}
    path = registry.recording_path(identity)
    return RecordingPart(path, identity, robot.hash, columns_of(robot), inputs, settings)


def _normaliser(records: Sequence[PopulationRecord]) -> Normaliser | None:
    """That of the only population."""
    if len(records) != 1:
        return None
    prefix = "normaliser."
    arrays = {k.removeprefix(prefix): v for k, v in records[0].arrays.items() if k.startswith(prefix)}
    return Normaliser.from_arrays(arrays)


def population_frame(registry: Registry, ref: str) -> "pd.DataFrame":
    """A population's entries by number: id, parameters in their units, losses, and the numbers that each links to.

    `attrs` of the frame tells the population's id, its robot and the units of the parameters. Raises NoMatchError where
    there is no such population, or where it has no entries, UsageError for one of effects.
    """
    import pandas as pd

    from dynreg.verbs.populations import load_graph

    record = registry.population(ref)
    require_models(record)
    held = registry.load(ref, ())
    graph = load_graph(registry, record.id, held.ids)
    columns = {"id": held.ids} | dict(zip(record.parameters, held.values.T, strict=True))
    columns |= {"own_loss": held.own_loss, "train_loss": held.train_loss, **held.extra}
    frame = pd.DataFrame(columns, index=pd.Index(held.numbers, name="number"))
    if graph is not None:
        frame["links"] = [tuple(held.numbers[np.asarray(ids)].tolist()) for ids in graph.neighbours]
    frame.attrs = {"population": record.id, "robot": record.name, "units": record.units}
    return frame
