"""Calibrate: fit a robot's parameters to a recording by a search over replays, the usual way.

The reference for `query`: the same parameters, the same replays, hundreds of simulations.
"""

import time
from collections.abc import Callable

import numpy as np

from dynreg.adapt.methods import METHODS
from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.registry import Registry
from dynreg.replay.cut import windows
from dynreg.replay.known import known_values
from dynreg.replay.parts import parts
from dynreg.replay.windows import Replayer, errors
from dynreg.results import Calibration, CalibrationStep, Cost, Estimate
from dynreg.search.cmaes import CmaEs
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot

Progress = Callable[[str, int, int], None]


def calibrate(
    registry: Registry,
    robot: Robot,
    recording: Recording,
    *,
    method: str = "cmaes",
    seed: int = 0,
    budget: int = 600,
    hold_out: str | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """The parameters with the lowest replay error on everything that is not held out.

    method : "cmaes" (from the nominal values) or "random" (uniform in the ranges).
    budget : replays, each one candidate through all windows that are not held out.
    Raises UsageError for an unknown method or a budget below 1.
    """
    if method not in METHODS or budget < 1:
        raise UsageError(
            f"method {method!r} with a budget of {budget}",
            expected=f"one of {list(METHODS)} and a budget of at least 1",
            do="correct it",
        )
    began = time.perf_counter()
    cut = windows(robot, recording)
    split = parts(recording, cut, hold_out)
    cut = cut.scaled_by(robot, split.chosen)
    replayer = Replayer(robot, cut, threads)
    fixed, start = _start(robot, recording)
    train = _losses(replayer, split.chosen)
    best, history = _search(train, robot, fixed, start, method, seed, budget, progress)
    rollouts = replayer.rollouts
    pair = np.stack([start, best])
    train_errors = train(pair)
    test = _losses(replayer, np.flatnonzero(split.test))(pair) if split.test.any() else [None, None]
    values = robot.space.from_unit(best)
    config = SimConfig(robot.hash, robot.name, robot.space.as_dict(values)).as_dict()
    simulator = registry.put_simulator(
        config | {"lineage": {"made_by": f"calibrate {method}", "recording": recording.id}}
    )
    return Calibration(
        robot=robot.name,
        recording=recording.id,
        method=method,
        simulator=simulator,
        parameters=_estimates(robot, best, values),
        train_error=float(train_errors[1]),
        test_error=None if test[1] is None else float(test[1]),
        nominal_train_error=float(train_errors[0]),
        nominal_test_error=None if test[0] is None else float(test[0]),
        history=tuple(CalibrationStep(simulations=n, error=e) for n, e in history),
        cost=Cost(
            evaluations=0,
            rollouts=rollouts,
            test_rollouts=2 * bool(split.test.any()),
            seconds=time.perf_counter() - began,
        ),
    )


def _start(robot: Robot, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Which parameters are known (P,) and the unit parameters to start from (P,)."""
    known = known_values(robot, recording)
    fixed = ~np.isnan(known)
    return fixed, robot.space.to_unit(np.where(fixed, known, robot.space.nominal))


def _losses(replayer: Replayer, chosen: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    def losses(unit: np.ndarray) -> np.ndarray:
        values = replayer.robot.space.from_unit(unit)
        return errors(replayer.residuals(values, chosen)).mean(axis=1)

    return losses


def _search(
    train: Callable[[np.ndarray], np.ndarray],
    robot: Robot,
    fixed: np.ndarray,
    start: np.ndarray,
    method: str,
    seed: int,
    budget: int,
    progress: Progress | None,
) -> tuple[np.ndarray, list[tuple[int, float]]]:
    """The best unit parameters (P,) and (simulations, best error) after each generation."""
    from dynreg.rng import stream

    free = np.flatnonzero(~fixed)
    search = CmaEs(start[free], seed=seed) if method == "cmaes" else None
    rng = stream(seed, "calibrate", robot.name)
    best, lowest, spent, history = start, np.inf, 0, []
    while spent < budget and not (search and search.stopped):
        asked = search.ask() if search else rng.uniform(size=(20, len(free)))
        unit = np.tile(start, (len(asked), 1))
        unit[:, free] = asked
        losses = train(unit)
        if search:
            search.tell(losses)
        spent += len(asked)
        if losses.min() < lowest:
            best, lowest = unit[int(losses.argmin())], float(losses.min())
        history.append((spent, lowest))
        if progress:
            progress("calibrate", min(spent, budget), budget)
    return best, history


def _estimates(robot: Robot, unit: np.ndarray, values: np.ndarray) -> dict[str, Estimate]:
    """A search gives no intervals: low and high are the value itself."""
    return {
        p.name: Estimate(
            value=float(v),
            low=float(v),
            high=float(v),
            unit=p.unit,
            nominal=p.nominal,
            limits=(p.low, p.high),
            at_bound=bool(u < 0.005 or u > 0.995),
        )
        for p, u, v in zip(robot.space.parameters, unit, values, strict=True)
    }
