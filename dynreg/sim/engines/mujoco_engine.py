"""Any MJCF robot on `mujoco.batch.Batch`: each simulation with its own model fields, on a thread pool."""

import numpy as np

from dynreg.sim.effects import Terms
from dynreg.sim.engines.arena import Arena
from dynreg.sim.engines.mujoco_model import quiet
from dynreg.sim.robot import Robot
from dynreg.sim.run import Rollout, Run


@quiet()
def rollout(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Rollout:
    """Simulate B configurations (B, P) through the E episodes of `run`, with the effects in `terms`.

    Simulations are independent of each other and of the number of threads, bit for bit. A simulation that
    diverges holds NaN from then on.
    """
    return Arena(robot, values, run, threads=threads, terms=terms).rollout(run)
