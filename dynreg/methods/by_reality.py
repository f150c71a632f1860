"""A gait and a simulator in turn, by scores of trials on the robot alone: paper B's way."""

import numpy as np

from dynreg.adapt.differences import unit_of
from dynreg.adapt.journalled import Journalled, Outcome, trial_name
from dynreg.adapt.reality import back_to_reality
from dynreg.adapt.tried import ADAPTED, START, Adapted, Rules
from dynreg.adapt.world import World
from dynreg.errors import NoMatchError
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task, fitness
from dynreg.gait.trials import Simulators, Trials
from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question
from dynreg.replay.known import nominal_known
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.sim.run import Walk, motor_noise


def rows_of(robot: Robot, task: Task) -> int:
    """Commands of one trial."""
    return max(round(task.seconds * robot.rate), 1)


class Played:
    """Gaits in the unit cube, run in simulators in the unit cube; counts the runs.

    Every simulator has the same motor noise: simulators are compared, and not their luck.
    """

    def __init__(self, robot: Robot, task: Task, seed: int = 0, threads: int = 0):
        self.space, self.rollouts = gait_space(robot, task.motion), 0
        self._robot, self._task, self._threads = robot, task, threads
        self.times = np.arange(rows_of(robot, task)) / robot.rate
        self._noise = motor_noise(np.array([seed]), 1, len(self.times), len(robot.actions))
        self._last: tuple[bytes, Trials] | None = None

    def __call__(self, gaits: np.ndarray, simulators: np.ndarray) -> np.ndarray:
        """(s, n) fitness of gaits (n, G) in simulators (s, P)."""
        return fitness(self._task.grade(self.walk(gaits, simulators)))

    def walk(self, gaits: np.ndarray, simulators: np.ndarray) -> Walk:
        """What gaits (n, G) do in simulators (s, P): (s, n)."""
        trials = self._trials(self._robot.space.from_unit(simulators))
        self.rollouts += len(gaits) * len(simulators)
        return trials.walk(self.genes(gaits))

    def genes(self, gaits: np.ndarray) -> np.ndarray:
        """(n, G) of gaits, changed as little as need be where the robot cannot run them."""
        return self.space.feasible(self.space.from_unit(gaits))

    def commands(self, gait: np.ndarray) -> np.ndarray:
        """(T, A) of a gait (G,)."""
        return self.space.targets(self.genes(gait[None]), self.times)[0]

    def _trials(self, values: np.ndarray) -> Trials:
        """Those of the last simulators are kept: what is compiled for them serves again."""
        key = values.tobytes()
        if self._last is None or self._last[0] != key:
            noise = np.broadcast_to(self._noise, (len(values), *self._noise.shape[1:]))
            told = {"rate": self._robot.rate, "threads": self._threads, "noise": noise}
            self._last = key, Trials(self._robot, self._task, Simulators(values), **told)
        return self._last[1]


class ByReality:
    """Back to Reality. It asks the robot for scores, and reads no state and no log of it; see `adapt.reality`.

    Versions: the simulator that it begins with, and one for each adaptation. `iteration 2` is that of the second, and
    `iteration 2, rolled back` the simulator before, used again because the newer one's gaits fell. before, after : mean
    difference of simulated and real scores, in the unit that `unit_of` tells.
    """

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """Its last simulator and best gait.

        Raises NoMatchError where no gait stood, BudgetError where none may be tried, UsageError for a gait that passes
        the robot's limits, before it moves.
        """
        trying = evidence.trying
        door, robot = trying.robot, trying.robot.robot
        played = Played(robot, door.task, limits.seed, limits.threads)
        whole = len(played.times) / robot.rate
        if not trying.goes_on:
            door.begin(whole)  # BudgetError before time is spent on a gait
        rules = (trying.rules or Rules()).within(limits.simulations)
        start = robot.space.nominal if question.start is None else question.start
        free = np.isnan(nominal_known(robot))

        def trial(gait: np.ndarray) -> Outcome:
            return door.try_out(played.commands(gait), robot.rate)

        kept = Journalled(lambda: door.begin(whole), trial, door.again, limits.journal("trials"), door.keeps)

        def checked(gait: np.ndarray) -> Outcome:
            played.space.require(played.genes(gait[None])[0])  # before it counts as a trial
            return kept(gait)

        world = World(
            played,
            checked,
            lambda step: stream(limits.seed, "btr", robot.name, step),
            limits.journal,
            played.space.periodic,
            lambda gaits: played.space.to_unit(played.genes(gaits)),
            limits.progress or (lambda *_: None),
        )
        gaits = played.space.to_unit(trying.gaits)
        found = back_to_reality(
            world, rules, gaits, np.clip(robot.space.to_unit(start), 0.0, 1.0), np.flatnonzero(free)
        )
        if found.best is None:
            _none_stood(door.name, len(found.tried), found.ended)
        return Answer(
            tuple(_version(robot, one, unit_of(rules.difference, door.task.unit)) for one in found.versions),
            found.ended,
            played.rollouts + found.resumed,
            (played.rollouts + found.resumed) * whole,
            resumed=found.resumed,
            free=free,
            tried=found.tried,
            best=found.best,
            gait=played.genes(found.best.gait[None])[0],
        )


def _version(robot: Robot, one: Adapted, unit: str) -> Version:
    stage = f"iteration {one.iteration}" if one.iteration else one.made
    return Version(
        stage if one.made in (START, ADAPTED) else f"{stage}, {one.made}",
        robot.space.from_unit(one.simulator),
        one.parent,
        (),
        one.before,
        one.after,
        unit=unit,
        trials=tuple(map(trial_name, one.trials)),
    )


def _none_stood(name: str, many: int, ended: str) -> None:
    if not many:
        raise NoMatchError(
            f"no gait scores above 0 in the simulator, so none was tried on robot {name!r}",
            expected="a gait that the simulator can do",
            do="raise --budget, begin with a gait that does (--gait), or with another simulator (--start)",
        )
    raise NoMatchError(
        f"every one of the gaits that were tried ({many}) fell on robot {name!r} (ended by: {ended})",
        expected="a gait that stands on the robot",
        do="begin with one that does (--gait), or with a simulator that is nearer to it (--start)",
    )
