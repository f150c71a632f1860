"""What advances many simulators at once. Configurations are crossed with episodes here, and only here.

Every engine is a `simulate` of the same signature: N independent simulations, each with parameters, an episode and
effects of its own. A simulation is the same, bit for bit, whatever is simulated beside it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms, stacked
from dynreg.sim.engine import ENGINES
from dynreg.sim.robot import Robot
from dynreg.sim.run import OF_EPISODES, OF_STEPS, Rollout, Run, Simulated, Walk

if TYPE_CHECKING:
    from mujoco import MjModel

# Numbers of the states, commands and inputs of one batch: half a GiB. What an engine holds beside them is of the same
# size, and engines are at their full rate long before (a joint at some thousand simulations, a quadruped at 64).
LARGEST = 2**26


@dataclass(frozen=True, eq=False)
class Case:
    """Configurations (B, P) that run through the E episodes of a run, with the effects that some or all B have."""

    values: np.ndarray
    run: Run
    terms: Terms | None = None

    def take(self, simulators: slice) -> "Case":
        """Only these configurations."""
        own = {
            name: a[simulators]
            for name in OF_STEPS
            if (a := getattr(self.run, name)) is not None and a.ndim == 4
        }
        terms = None if self.terms is None else self.terms.take(simulators)
        return Case(self.values[simulators], replace(self.run, **own), terms)

    def crossed(self) -> "Case":
        """As B E configurations, each with an episode of its own; those of a configuration in a row."""
        count, episodes = len(self.values), self.run.episodes
        own: dict[str, np.ndarray] = {}
        for name in (*OF_EPISODES, *OF_STEPS):
            a = getattr(self.run, name)
            if a is not None:
                each = a if name in OF_STEPS and a.ndim == 4 else np.broadcast_to(a, (count, *a.shape))
                own[name] = each.reshape(count * episodes, *each.shape[2:])
        every = np.repeat(np.arange(count), episodes)
        terms = None if self.terms is None else self.terms.take(every)
        return Case(self.values[every], replace(self.run, **own), terms)


class Arena:
    """B simulators, each for E episodes, set up and settled once on MuJoCo; every run starts there.

    `run` gives the number of episodes and all but the commands: settings, inputs, initial states, period, noise.
    slope : angle [rad] of the ground, rising ahead of the robot. laid : where bodies beside it lie; see `Simulations`.
    """

    def __init__(
        self,
        robot: Robot,
        values: np.ndarray,
        run: Run,
        *,
        threads: int = 0,
        terms: Terms | None = None,
        slope: float = 0.0,
        laid: np.ndarray | None = None,
    ):
        from dynreg.sim.engines.arena import Simulations

        self._values, self._shape = values, (len(values), run.episodes)
        case = Case(values, run, terms).crossed()
        self._simulations = Simulations(
            robot, case.values, case.run, threads=threads, terms=case.terms, slope=slope, laid=laid
        )

    def rollout(self, run: Run) -> Rollout:
        """The whole episodes under the commands and motor noise of `run`, as the log would hold them."""
        return _rollout(self._simulations.play(self._crossed(run)), self._shape)

    def walk(self, run: Run, *, feet: bool = False) -> Walk:
        """How the base moves under the commands and motor noise of `run`; a simulator ends where it falls.

        feet : look at which feet (spheres that can touch the ground) touch it, too: that is slower.
        Raises SimulationError for a robot without a floating base.
        """
        walk = self._simulations.walk(self._crossed(run), feet=feet)
        contact = {name: _folded(touches, self._shape) for name, touches in walk.contact.items()}
        base, fell = _folded(walk.base, self._shape), _folded(walk.fell, self._shape)
        bodies = None if walk.bodies is None else _folded(walk.bodies, self._shape)
        return Walk(base, fell, walk.physics_steps, contact, bodies)

    def poses(self, run: Run) -> np.ndarray:
        """(B, E, T+1, nq) where all joints of the model are at the command times, for drawing.

        Falls go on to the end; a simulator that diverges holds NaN from then on.
        """
        return _folded(self._simulations.poses(self._crossed(run)), self._shape)

    def model(self, simulator: int) -> "MjModel":
        """A copy of the MuJoCo model of a simulator (its number), with its parameters and effects in the fields."""
        return self._simulations.model(simulator * self._shape[1])

    def _crossed(self, run: Run) -> Run:
        return Case(self._values, run).crossed().run


def rollout(
    robot: Robot,
    values: np.ndarray,
    run: Run,
    *,
    engine: str | None = None,
    threads: int = 0,
    terms: Terms | None = None,
) -> Rollout:
    """Simulate configurations (B, P) through the E episodes of `run`: `rollouts` of one case."""
    return rollouts(robot, [Case(values, run, terms)], engine=engine, threads=threads)[0]


def rollouts(
    robot: Robot, cases: Sequence[Case], *, engine: str | None = None, threads: int = 0
) -> list[Rollout]:
    """What the simulators of each case do, on an engine that the robot offers, as many at once as can be.

    engine : one of the robot's; its first by default.
    threads : 0 for all cores. The numbers depend neither on it nor on the other cases.
    Raises UsageError where the robot does not offer the engine, SimulationError where nothing says how long a command
    lasts.
    """
    simulate = import_module(ENGINES[robot.running(engine)].module).simulate
    if any(case.run.period is None for case in cases) and not robot.file.robot.control_rate:
        raise SimulationError(
            f"a run of {robot.name!r} without a period",
            expected="a period [s]: the robot's control is timed, and says none",
            do="set Run.period",
        )
    found: list[list[Simulated]] = [[] for _ in cases]
    for numbers, parts in _batches(robot, cases):
        batch = _joined([part.crossed() for part in parts])
        done = simulate(robot, batch.values, batch.run, threads=threads, terms=batch.terms)
        end = 0
        for number, part in zip(numbers, parts, strict=True):
            begin, end = end, end + len(part.values) * part.run.episodes
            own = (a[begin:end] for a in (done.states, done.fell, done.taken))
            found[number].append(Simulated(*own))
    shapes = [(len(case.values), case.run.episodes) for case in cases]
    return [_rollout(_whole(parts), shape) for parts, shape in zip(found, shapes, strict=True)]


def _batches(robot: Robot, cases: Sequence[Case]) -> Iterator[tuple[tuple[int, ...], tuple[Case, ...]]]:
    """What is simulated at once: numbers of cases, and as many cases or parts of them.

    They share steps, period, joints and what is given. A case is cut between configurations where it is too large.
    """
    width = 1 + len(robot.channels) + len(robot.actions) + len(robot.inputs)
    alike: dict[tuple, list[tuple[int, int, Case]]] = {}  # (numbers before it, number of the case, part)
    for number, case in enumerate(cases):
        run = case.run
        given = {name: a for name in (*OF_EPISODES, *OF_STEPS) if (a := getattr(run, name)) is not None}
        told = run.before.shape[1] if run.before is not None else 0
        kind = alike.setdefault((run.steps, run.period, run.joints, told, *given), [])
        each = (run.steps + 1) * width * run.episodes
        most = max(LARGEST // each, 1)
        for begin in range(0, max(len(case.values), 1), most):
            part = case.take(slice(begin, begin + most))
            before = kind[-1][0] + each * len(kind[-1][2].values) if kind else 0
            kind.append((before, number, part))
    for parts in alike.values():
        for _, together in groupby(parts, lambda part: part[0] // LARGEST):
            _, numbers, own = zip(*together, strict=True)
            yield numbers, own


def _joined(crossed: Sequence[Case]) -> Case:
    """Crossed cases that can share a batch, one after the other."""
    if len(crossed) == 1:
        return crossed[0]
    given = [name for name in (*OF_EPISODES, *OF_STEPS) if getattr(crossed[0].run, name) is not None]
    own = {name: np.concatenate([getattr(case.run, name) for case in crossed]) for name in given}
    values = np.concatenate([case.values for case in crossed])
    ends = np.cumsum([len(case.values) for case in crossed])
    groups = [
        (np.arange(end - len(case.values), end), case.terms)
        for case, end in zip(crossed, ends, strict=True)
        if case.terms is not None
    ]
    return Case(values, replace(crossed[0].run, **own), stacked(len(values), groups))


def _whole(parts: list[Simulated]) -> Simulated:
    """The parts of a case, one after the other."""
    if len(parts) == 1:
        return parts[0]
    return Simulated(*(np.concatenate([getattr(p, f) for p in parts]) for f in ("states", "fell", "taken")))


def _rollout(done: Simulated, shape: tuple[int, int]) -> Rollout:
    return Rollout(_folded(done.states, shape), _folded(done.fell, shape), int(done.taken.sum()))


def _folded(a: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(B E, ...) -> (B, E, ...)."""
    return a.reshape(*shape, *a.shape[1:])
