"""What a simulator is worth to a robot that shall walk: a gait is sought in it, and tried on the robot.

No search is told the packaged gaits. What a search finds hangs on its draws, so there are some of them, and the one in
the middle counts. A gait is tried three times; a fall counts as 0. Besides, simulators rank gaits that all of them and
the robot have run: Spearman's correlation of scores.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynreg.adapt.differences import rank_correlation
from dynreg.evidence.truth import Hidden
from dynreg.gait.seek import SearchSettings, seek
from dynreg.gait.tasks import Task, fitness, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import Robot

SOUGHT = 300  # gaits of a search
SEARCHES = 3  # in each simulator
TRIALS = 3  # of the answer of each on the robot
FIXED = 20  # gaits by which simulators are ranked


@dataclass(frozen=True, eq=False)
class Walks:
    """One hidden robot as one that walks."""

    robot: Robot
    hidden: Hidden
    threads: int

    @cached_property
    def task(self) -> Task:
        """Ahead, for the seconds of the robot's first task."""
        return task_of(self.robot)

    @property
    def real(self) -> SimulatedRobot:
        """The door to it, without a limit."""
        told = {"seed": self.hidden.seed, "threads": self.threads}
        return SimulatedRobot(
            self.robot, self.hidden.parameters, self.hidden.terms, self.hidden.values, **told
        )

    def figures(self, config: SimConfig, searches: int) -> Mapping[str, object]:
        """{"speed", "simulated" [m/s], "falls", "trials", "rank"} of gaits sought in a simulator, and of the simulator.

        speed : of the middle one of the searches, by its speed on the robot; simulated : of the same gait. falls :
        trials that fell, of all searches. trials : how many there were.
        """
        trials, real, found = self._trials(config), self.real, []
        for number in range(searches):
            seed = (self.hidden.seed + number) % 2**31
            one = seek(trials, SearchSettings(rollouts=SOUGHT, seed=seed, again=0.2, packaged=False))
            actions = trials.space.targets(one.genes[None], trials.times)[0]
            scores = [self._score(real, actions, f"search_{number}_trial_{i}") for i in range(TRIALS)]
            speed = float(np.mean([s or 0.0 for s in scores]) / self.task.seconds)
            found.append((speed, float(one.found.value / self.task.seconds), scores.count(None)))
        speed, simulated, _ = sorted(found)[searches // 2]
        sim = fitness(trials.grades(self._fixed(trials)))[:, 0]
        return {
            "speed": speed,
            "simulated": simulated,
            "falls": sum(falls for _, _, falls in found),
            "trials": TRIALS * searches,
            "rank": float(rank_correlation(sim[None], self.ranked)[0]),
        }

    @cached_property
    def ranked(self) -> np.ndarray:
        """(FIXED,) scores of the fixed gaits on the robot."""
        trials, real = self._trials(SimConfig.of(self.robot, self.robot.space.nominal)), self.real
        rows = trials.space.targets(self._fixed(trials), trials.times)
        return np.array([self._score(real, row, f"fixed_{i}") or 0.0 for i, row in enumerate(rows)])

    def _score(self, real: SimulatedRobot, actions: np.ndarray, name: str) -> float | None:
        trial = real.run(actions, self.robot.rate, name)
        return None if trial.fell else float(fitness(self.task.grade(trial.walk))[0, 0])

    def _fixed(self, trials: Trials) -> np.ndarray:
        space = trials.space
        drawn = space.about_rest(FIXED, stream(self.hidden.seed, "fixed gaits"))
        return space.feasible(space.from_unit(drawn))

    def _trials(self, config: SimConfig) -> Trials:
        values = self.robot.space.from_dict(dict(config.values))[None]
        own = Simulators(values, terms_of(config, self.robot) if config.effects else None)
        told = {"rate": self.robot.rate, "seed": self.hidden.seed % 2**31, "threads": self.threads}
        return Trials(self.robot, self.task, own, **told)
