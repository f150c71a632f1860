"""What advances many simulators at once: every engine is a `rollout` of the same signature."""

from importlib import import_module

import numpy as np

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms
from dynreg.sim.engine import ENGINES
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run


def rollout(
    robot: Robot,
    values: np.ndarray,
    run: Run,
    *,
    engine: str | None = None,
    threads: int = 0,
    terms: Terms | None = None,
) -> Rollout:
    """Simulate configurations (B, P) through the episodes of `run` on an engine that the robot offers.

    engine : one of the robot's; its first by default.
    threads : 0 for all cores. The numbers do not depend on it.
    terms : effects that some or all of the B simulators have.
    Raises SimulationError where the robot does not offer the engine, or nothing says how long a command lasts.
    """
    name = robot.running(engine)
    if run.period is None and not robot.file.robot.control_rate:
        raise SimulationError(
            f"a run of {robot.name!r} without a period",
            expected="a period [s]: the robot's control is timed, and says none",
            do="set Run.period",
        )
    return import_module(ENGINES[name].module).rollout(robot, values, run, threads=threads, terms=terms)
