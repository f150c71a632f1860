"""The document of a calibration: its numbers with their names and units, and the simulators on the way, registered."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Question
from dynreg.results.calibration import (
    Calibration,
    CalibrationCost,
    CalibrationStep,
    CalibrationVersion,
    Fitted,
)
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot
from dynreg.verbs.subjects import Recorded

if TYPE_CHECKING:
    from dynreg.distance.population import Population
    from dynreg.verbs.calibrate import CalibrateSettings


def register(
    asked: Recorded, method: str, found: Answer, configs: Sequence[SimConfig], begin: str | None
) -> tuple[tuple[str, str | None], ...]:
    """(id, parent's id) of each version's simulator, registered with what it came from; None is the nominal one.

    begin : id of the simulator that the question begins with.
    """
    out: list[tuple[str, str | None]] = []
    for version, config in zip(found.versions, configs, strict=True):
        parent = version.entry or begin if version.parent is None else out[version.parent][0]
        lineage = {
            "made_by": f"calibrate {method}",
            "stage": version.stage,
            "recording": asked.recording.id,
            "episodes": list(version.episodes),
        }
        lineage |= {} if parent is None else {"parent": parent}
        if asked.each:
            lineage["recordings"] = [one.recording.id for one in asked.each]
        out.append((asked.registry.put_simulator(config.as_dict() | {"lineage": lineage}), parent))
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
    """The document; ids : see `register`. errors : (2, 2) of what the method began with and of its answer, by part."""
    cut = question.data
    nominal, answer = errors.tolist()
    tested = cut.parts.test.any()
    return Calibration(
        robot=cut.robot.name,
        recording=asked.recording.id,
        method=settings.method,
        simulator=ids[-1][0],
        versions=tuple(_version(asked, one, *told) for one, told in zip(found.versions, ids, strict=True)),
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


def _version(asked: Recorded, version: Version, simulator: str, parent: str | None) -> CalibrationVersion:
    of = {one.name: one.recording.id for one in asked.each}
    recordings = dict.fromkeys(of.get(e.split("/")[0], asked.recording.id) for e in version.episodes)
    return CalibrationVersion(
        simulator=simulator,
        stage=version.stage,
        parent=parent,
        recordings=tuple(recordings),
        episodes=version.episodes,
        before=version.before,
        after=version.after,
        figures=dict(version.figures),
    )


def parameters(robot: Robot, found: Answer) -> dict[str, Fitted]:
    """{name: value} of the answer, with units, ranges and intervals."""
    values = found.final.values
    edge = robot.space.at_bound(robot.space.to_unit(values))
    out = {}
    for p, v, at in zip(robot.space.parameters, values.tolist(), edge, strict=True):
        low, high = found.intervals.get(p.name, (None, None))
        limits = (p.low, p.high)
        out[p.name] = Fitted(
            value=v, low=low, high=high, unit=p.unit, nominal=p.nominal, at_bound=bool(at), limits=limits
        )
    return out
