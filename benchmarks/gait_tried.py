"""What gaits do on hidden quadrupeds: one search, its simulators, and trials on the robot."""

import numpy as np
from gait_jobs import TRIALS
from walkers import RATE, Walker

from dynreg.gait.seek import SearchSettings, seek
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Trials
from dynreg.sim.real import SimulatedRobot


def searched(walker: Walker, trials: Trials, real: SimulatedRobot, settings: SearchSettings) -> dict:
    """What the gait of one search does in its simulators and on the robot."""
    sought = seek(trials, settings)
    return {
        **tried(walker, real, trials.space.targets(sought.genes[None], trials.times)[0]),
        "simulated": sought.finals.value if sought.finals else sought.found.value,
        "gaits": sought.found.evaluations,
        "genes": sought.genes.tolist(),
    }


def tried(walker: Walker, real: SimulatedRobot, actions: np.ndarray) -> dict:
    """What a gait does on the robot in `TRIALS` trials: the mean, falls, and whether it walks."""
    task = task_of(walker.robot)
    trials = [real.run(actions, RATE, f"trial_{i}") for i in range(TRIALS)]
    there, falls = [float(fitness(task.grade(t.walk))[0, 0]) for t in trials], sum(t.fell for t in trials)
    mean = float(np.mean(there))
    return {"real": mean, "trials": there, "fell": falls, "success": not falls and mean >= task.success}
