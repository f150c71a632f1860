"""What advances many simulators at once: every engine is a `rollout` of the same signature."""

from importlib import import_module
from types import MappingProxyType

import numpy as np

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run

ENGINES = MappingProxyType(
    {
        "mujoco": "dynreg.sim.engines.mujoco_engine",
        "joint": "dynreg.sim.engines.joint_engine",
        "kinematic": "dynreg.sim.engines.kinematic_engine",
        "unicycle": "dynreg.sim.engines.unicycle_engine",
    }
)


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
    offered = robot.file.robot.engines
    name = engine or offered[0]
    if name not in offered:
        raise SimulationError(
            f"robot {robot.name!r} has no engine {name!r}",
            expected=f"one of {list(offered)}",
            do="choose one of them, or add it to robot.toml",
        )
    if run.period is None and not robot.file.robot.control_rate:
        raise SimulationError(
            f"a run of {robot.name!r} without a period",
            expected="a period [s]: the robot's control is timed, and says none",
            do="set Run.period",
        )
    return import_module(ENGINES[name]).rollout(robot, values, run, threads=threads, terms=terms)
