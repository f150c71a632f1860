"""The document of a calibration: its numbers with their names and units, and the simulators on the way, registered."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynreg.methods.answer import Answer
from dynreg.methods.calibrator import Question
from dynreg.registry import Registry
from dynreg.results.calibration import (
    Calibration,
    CalibrationCost,
    CalibrationStep,
    CalibrationVersion,
    Fitted,
)
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot
from dynreg.verbs.several import parted
from dynreg.verbs.subjects import Recorded

if TYPE_CHECKING:
    from dynreg.distance.population import Population
    from dynreg.verbs.calibrate import CalibrateSettings


def register(
    registry: Registry,
    found: Answer,
    configs: Sequence[SimConfig],
    begin: str | None,
    origin: Mapping[str, Any],
) -> tuple[tuple[str, str | None], ...]:
    """(id, parent's id) of each version's simulator, registered with what it came from; None is the nominal one.

    begin : id of the simulator that the question begins with. origin : what every lineage says, beside the stage, the
    parent and the episodes or the trials that shaped it.
    """
    out: list[tuple[str, str | None]] = []
    for version, config in zip(found.versions, configs, strict=True):
        parent = version.entry or begin if version.parent is None else out[version.parent][0]
        lineage = {**origin, "stage": version.stage}
        lineage |= {"episodes": list(version.episodes)} if "recording" in origin else {}
        lineage |= {"trials": list(version.trials)} if version.trials else {}
        lineage |= {} if parent is None else {"parent": parent}
        out.append((registry.put_simulator(config.as_dict() | {"lineage": lineage}), parent))
    return tuple(out)


def document(
    asked: Recorded,
    settings: "CalibrateSettings",
    question: Question,
    population: "Population | None",
    found: Answer,
    ids: Sequence[tuple[str, str | None]],
    errors: np.ndarray,
    cost: CalibrationCost,
) -> Calibration:
    """The document; ids : see `register`. errors : (2, 2) of the nominal simulator, with what the recording tells,
    and of the answer, by part.
    """
    cut = question.data
    nominal, answer = errors.tolist()
    tested = cut.parts.test.any()
    return Calibration(
        robot=cut.robot.name,
        recording=asked.recording.id,
        recording_name=asked.name,
        method=settings.method,
        simulator=ids[-1][0],
        versions=versions(found, ids, asked),
        parameters=parameters(cut.robot, found),
        causes=found.causes,
        train_error=answer[0],
        test_error=answer[1] if tested else None,
        nominal_train_error=nominal[0],
        nominal_test_error=nominal[1] if tested else None,
        history=tuple(
            CalibrationStep(stage=v.stage, simulations=n, error=e)
            for v in found.versions
            for n, e in v.history
        ),
        parts=cut.named,
        ended=found.ended,
        population=population and population.id,
        seed=settings.seed,
        cost=cost,
    )


def versions(
    found: Answer, ids: Sequence[tuple[str, str | None]], asked: Recorded | None = None
) -> tuple[CalibrationVersion, ...]:
    """The versions of an answer. ids : see `register`. asked : None where no recording shaped any."""

    def of(episode: str) -> str | None:
        if asked is None:
            return None
        return (parted(episode, asked.each)[0] if asked.each else asked).recording.id

    return tuple(
        CalibrationVersion(
            simulator=simulator,
            stage=version.stage,
            parent=parent,
            recordings=tuple(dict.fromkeys(of(e) for e in version.episodes)),
            episodes=version.episodes,
            before=version.before,
            after=version.after,
            unit=version.unit,
            figures=dict(version.figures),
            trials=version.trials,
        )
        for version, (simulator, parent) in zip(found.versions, ids, strict=True)
    )


def parameters(robot: Robot, found: Answer) -> dict[str, Fitted]:
    """{name: value} of the answer, with units, ranges and intervals."""
    values = found.final.values
    edge = robot.space.at_bound(robot.space.to_unit(values))
    free, out = np.ones(len(values), dtype=bool) if found.free is None else found.free, {}
    for p, v, at, moves in zip(robot.space.parameters, values.tolist(), edge, free.tolist(), strict=True):
        low, high = found.intervals.get(p.name, (None, None))
        limits = (p.low, p.high)
        out[p.name] = Fitted(
            value=v,
            low=low,
            high=high,
            unit=p.unit,
            nominal=p.nominal,
            at_bound=bool(at),
            limits=limits,
            free=moves,
        )
    return out
