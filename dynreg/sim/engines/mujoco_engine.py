"""Any MJCF robot on `mujoco.batch.Batch`: each simulation with its own model fields, on a thread pool."""

import numpy as np

from dynreg.sim.effects import Terms
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.engines.mujoco_model import by_model, quiet
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Simulated


@quiet()
def simulate(
    robot: Robot, values: np.ndarray, run: Run, *, threads: int = 0, terms: Terms | None = None
) -> Simulated:
    """N simulations, each of parameters (N, P), an episode of `run` and the effects in `terms` of its own.

    Simulations are independent of each other and of the number of threads, bit for bit. A simulation that
    diverges holds NaN from then on. Those whose effects make another model of the robot run apart from the others.
    """
    done: Simulated | None = None
    for rows in by_model(terms, len(values)):
        own = terms and terms.take(rows)
        part = Simulations(robot, values[rows], run.take(rows), threads=threads, terms=own).play(
            run.take(rows)
        )
        if len(rows) == len(values):
            return part
        if done is None:
            done = Simulated(*(np.empty((len(values), *a.shape[1:]), a.dtype) for a in _arrays(part)))
        for whole, some in zip(_arrays(done), _arrays(part), strict=True):
            whole[rows] = some
    return done


def _arrays(done: Simulated) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return done.states, done.fell, done.taken
