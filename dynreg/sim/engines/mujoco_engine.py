"""Any MJCF robot on `mujoco.batch.Batch`: each simulation with its own model fields, on a thread pool."""

import numpy as np

from dynreg.sim.effects import Terms
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.engines.mujoco_model import quiet
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated


@quiet()
def simulate(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Simulated:
    """N simulations, each of parameters (N, P), an episode of `run` and the effects in `terms` of its own.

    Simulations are independent of each other and of the number of threads, bit for bit. A simulation that
    diverges holds NaN from then on.
    """
    return Simulations(robot, values, run, threads=threads, terms=terms).play(run)
