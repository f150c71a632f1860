"""Calibrate: fit a robot's parameters to a recording by a black-box search, as a baseline for a query."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, hold_out, method, option, seed, threads

if TYPE_CHECKING:
    from dynreg.results.calibration import Calibration
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class CalibrateSettings(Settings):
    """The settings of `calibrate`."""

    method: str = method()
    seed: int = seed()
    budget: int = option(600, "Most simulations of the search.", least=1)
    hold_out: str | None = hold_out()
    threads: int = threads()


def calibrate(
    asked: "Recorded", settings: CalibrateSettings, progress: Progress | None = None
) -> "Calibration":
    """Fit a robot's parameters to a recording by a search.

    It is the baseline of a query and needs no population. The search begins at the nominal values of the robot. Its
    answer is never worse than these on the train part.

    Example: dynreg calibrate monday --method cma --hold-out kp=400
    """
    from dynreg.adapt.calibrate import calibrate
    from dynreg.replay.data import data
    from dynreg.results.calibration import Calibration, CalibrationStep, Fitted
    from dynreg.results.result import Cost
    from dynreg.sim.config import SimConfig

    began, robot = time.perf_counter(), asked.robot
    cut = data(robot, asked.recording, settings.hold_out)
    found = calibrate(
        cut,
        settings.method,
        budget=settings.budget,
        seed=settings.seed,
        threads=settings.threads,
        progress=progress and (lambda done, total: progress("calibrate", done, total)),
    )
    seconds = time.perf_counter() - began
    values = cut.values_of(found.unit)
    edge = robot.space.at_bound(found.unit)
    parameters = {
        p.name: Fitted(value=v, unit=p.unit, nominal=p.nominal, at_bound=bool(at), limits=(p.low, p.high))
        for p, v, at in zip(robot.space.parameters, values.tolist(), edge, strict=True)
    }
    config = SimConfig.of(robot, values).as_dict()
    lineage = {"made_by": f"calibrate {settings.method}", "recording": asked.recording.id}
    tested = (None, None) if not found.test_rollouts else found.test
    return Calibration(
        robot=robot.name,
        recording=asked.recording.id,
        method=settings.method,
        simulator=asked.registry.put_simulator(config | {"lineage": lineage}),
        parameters=parameters,
        train_error=found.train[1],
        test_error=tested[1],
        nominal_train_error=found.train[0],
        nominal_test_error=tested[0],
        history=tuple(CalibrationStep(simulations=n, error=e) for n, e in found.history),
        cost=Cost(evaluations=0, rollouts=found.rollouts, test_rollouts=found.test_rollouts, seconds=seconds),
    )
