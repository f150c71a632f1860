"""The only door to a robot whose truth is not known: every trial is counted, and the budget is kept.

A `RealRobot` plays commands from their first to their last; other doors (`timed.evolve`) are asked step by step.
`SimulatedRobot` is one for experiments: secret parameters, effects that no simulator of the family has, a finer
time step, a torque disturbance, sensor noise and quantisation.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from dynreg.data.names import quantity_of
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import BudgetError, UsageError
from dynreg.rng import stream
from dynreg.sim.effects import Term, Terms
from dynreg.sim.effects.disturbance import Disturbance, Unsteadiness
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.ports import largest_speeds, nominal_ports, servo_law
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Walk
from dynreg.sim.sets import is_limit

FINER = 10  # physics steps of the truth for one of the model
DISTURBANCE = 0.005  # of each drive's own limit, 1 sigma, drawn anew for every command
COUNTS = 4096  # a turn, of encoders that state no quantum
LEAST_NOISE = 0.0005  # rad or m, of positions that state neither noise nor quantum


@dataclass(frozen=True)
class Budget:
    """What trials on a robot may cost in all: their number, their seconds, falls; None for no limit."""

    trials: int | None = None
    seconds: float | None = None
    falls: int | None = None


@dataclass(frozen=True)
class Spent:
    """What trials have cost so far."""

    trials: int = 0
    seconds: float = 0.0
    falls: int = 0


@dataclass(frozen=True, eq=False)
class RealTrial:
    """One trial: its log, and how the body moved (1, 1, T+1, 12), as a camera or a tape measure tells.

    walk : None of a robot whose base is held, or that has wheels.
    """

    recording: Recording
    walk: Walk | None

    @property
    def fell(self) -> bool:
        """Whether the robot fell."""
        return self.walk is not None and bool(self.walk.fell[0, 0] < self.walk.base.shape[2])

    def lasted(self, steps: int) -> int:
        """How many of so many commands were played before it fell."""
        return steps if self.walk is None else int(min(self.walk.fell[0, 0], steps))


@dataclass
class Door(ABC):
    """What every door to a robot has: a budget, what trials have cost so far, and the robot's name."""

    budget: Budget = field(default=Budget(), kw_only=True)
    spent: Spent = field(default=Spent(), kw_only=True)

    @property
    @abstractmethod
    def name(self) -> str:
        """What messages call the robot."""

    def afford(self, seconds: float, trials: int = 1, falls: int = 1) -> None:
        """BudgetError, which says what is spent, without room for so much more: by default a trial, which may fall."""
        left = (
            ("trials", self.budget.trials, self.spent.trials, trials),
            ("seconds", self.budget.seconds, self.spent.seconds, seconds),
            ("falls", self.budget.falls, self.spent.falls, falls),
        )
        for what, most, spent, price in left:
            if most is not None and spent + price > most + 1e-9:
                raise BudgetError(
                    f"the budget of {most:g} {what} on robot {self.name!r} is spent ({spent:g} used)",
                    expected=f"room for {price:g} more",
                    do="work with the logs that there are, or grant a larger budget",
                    what=what,
                )

    def spend(self, seconds: float, trials: int = 1, falls: int = 0) -> None:
        """Count it."""
        before = self.spent
        self.spent = Spent(before.trials + trials, before.seconds + seconds, before.falls + falls)


@dataclass
class RealRobot(Door):
    """A robot on which commands can be tried, for a price, which `run` counts. A kind of robot gives `play`.

    tracks : whether its trials tell where the tracked bodies beside the robot went.
    """

    tracks: ClassVar[bool] = True

    robot: Robot

    @property
    def name(self) -> str:
        return self.robot.name

    @abstractmethod
    def play(self, actions: np.ndarray, rate: float, name: str) -> RealTrial:
        """Play commands (T, A), `rate` a second, from rest until their end or a fall."""

    def run(self, actions: np.ndarray, rate: float, name: str = "trial") -> RealTrial:
        """`play`, counted; a trial that ends with an error counts, too, for the robot may have moved.

        Raises BudgetError before anything moves where the budget is spent or would be, UsageError for commands
        that are not the robot's.
        """
        self._check(actions, rate)
        self.afford(len(actions) / rate)
        try:
            trial = self.play(actions, rate, name)
        except BaseException:
            self.spend(len(actions) / rate)
            raise
        self.spend(trial.lasted(len(actions)) / rate, falls=int(trial.fell))
        return trial

    def _check(self, actions: np.ndarray, rate: float) -> None:
        if actions.ndim != 2 or actions.shape[1] != len(self.robot.actions) or not len(actions):
            raise UsageError(
                f"commands of shape {actions.shape}",
                expected=f"(1 or more steps, {len(self.robot.actions)})",
                do="give one column for each action",
            )
        lost = np.argwhere(~np.isfinite(actions))
        if len(lost) or not 0.0 < rate < np.inf:
            what = (
                f"command {actions[tuple(lost[0])]} in step {lost[0, 0]}" if len(lost) else f"rate = {rate}"
            )
            raise UsageError(
                f"{what} for robot {self.robot.name!r}",
                expected="finite commands, and more than 0 of them a second",
                do="correct them",
            )


_DISTURBANCE, _UNSTEADINESS = Term(Disturbance()), Term(Unsteadiness())


def disturbance(robot: Robot, limits: np.ndarray) -> Terms:
    """Noise, by the draws of `disturbed`, on what the drives of one simulator give: of each a share of its own limit.

    On torques, of a planar base on speeds. limits : (A,) of the drives, as `drive_limits` or `Coordinates` have them.
    """
    own = _UNSTEADINESS if robot.planar else _DISTURBANCE
    return Terms((own,), (np.array([[DISTURBANCE * limits.mean()]]),))


def disturbed(run: Run, limits: np.ndarray, rng: np.random.Generator) -> Run:
    """The run with draws of its own for every episode; `limits` as in `disturbance`."""
    return replace(run, draws=draws((run.episodes, run.steps), limits, rng))


def draws(shape: tuple[int, ...], limits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(*shape, A) draws of a disturbance: it has one size for all drives, and so each draw its drive's limit over their
    mean."""
    mean = limits.mean()
    return rng.standard_normal((*shape, len(limits))) * (limits / mean if mean > 0 else 1.0)


def drive_limits(robot: Robot) -> np.ndarray:
    """(A,) what a disturbance of each drive is a share of: its torque limit, in a planar base its largest speed.

    In the unit of what it gives. 0 for a drive that states no limit.
    """
    if robot.planar:
        return largest_speeds(robot)
    limit = servo_law(nominal_ports(robot, 1), robot.input_defaults[None]).limit[0]
    return np.where(is_limit(limit), limit, 0.0)


def finer(robot: Robot) -> Robot:
    """The robot with a physics time step `FINER` times finer, where nothing collides with the Runge-Kutta integrator.

    MuJoCo's other integrators are of first order: what they hold over a time step acts half of it too early, and the
    delay that a diagnosis finds would rightly be shorter than the hidden one.
    """
    model = robot.model
    collides = model.npair or model.geom_contype.any() or model.geom_conaffinity.any()
    return robot.stepped(FINER, **({} if collides else {"integrator": "rk4"}))


def sensed(robot: Robot, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """States (..., S) as the robot's sensors say them: noise, then quantisation."""
    noise = np.array([c.noise for c in robot.file.channels])
    quantum = np.array([c.quantum for c in robot.file.channels])
    position = np.array([quantity_of(name) == "position" for name in robot.channels])
    turns = np.array([c.unit == "rad" for c in robot.file.channels])
    noise = np.where(position & (noise == 0) & (quantum == 0), LEAST_NOISE, noise)
    quantum = np.where(position & turns & (quantum == 0), 2 * np.pi / COUNTS, quantum)
    states = states + noise * rng.standard_normal(states.shape)
    grid = np.where(quantum > 0, quantum, 1.0)
    return np.where(quantum > 0, np.round(states / grid) * grid, states)


@dataclass(frozen=True, eq=False)
class Secret:
    """What a simulated robot is from a trial on: true parameters (P,) and effects, each term with its values."""

    parameters: np.ndarray
    terms: tuple[Term, ...] = ()
    values: tuple[np.ndarray, ...] = ()


@dataclass
class SimulatedRobot(RealRobot):
    """A robot with a secret: true parameters (P,) and effects, each term with its values; see `RealRobot`.

    It walks, its base is held, or it is a base on wheels. Every trial has disturbances and sensor noise of its own,
    drawn from `seed` and the number of the trial.
    slope : angle [rad] of the ground. laid : where bodies beside it lie, as in `Arena`. changes : {number of a trial:
    what the robot is from it on}, as it wears.
    """

    parameters: np.ndarray
    terms: tuple[Term, ...] = ()
    values: tuple[np.ndarray, ...] = ()
    seed: int = 0
    slope: float = 0.0
    laid: np.ndarray | None = None
    threads: int = 1
    changes: Mapping[int, Secret] = field(default_factory=dict)

    def play(self, actions: np.ndarray, rate: float, name: str) -> RealTrial:
        number = self.spent.trials
        truth, secret = finer(self.robot), self.secret(number)
        rng, limits = stream(self.seed, "real robot", self.robot.name, number), drive_limits(self.robot)
        noise = rng.standard_normal((1, 1, *actions.shape))
        run = disturbed(Run(actions[None], period=1.0 / rate, noise=noise), limits, rng)
        active = Terms(secret.terms, tuple(v[None] for v in secret.values)) + disturbance(truth, limits)
        if not self.robot.floating:
            told = {"terms": active, "threads": self.threads}
            states = rollout(truth, secret.parameters[None], run, **told).states[0, 0]
            return RealTrial(self._log(sensed(self.robot, states, rng), actions, rate, name), None)
        told = {"terms": active, "threads": self.threads, "slope": self.slope, "laid": self.laid}
        arena = Arena(truth, secret.parameters[None], run, **told)
        walk = arena.walk(run)
        ends = int(min(walk.fell[0, 0], len(actions)))
        states = arena.rollout(run).states[0, 0, : ends + 1]
        return RealTrial(self._log(sensed(self.robot, states, rng), actions, rate, name), walk)

    def secret(self, trial: int) -> Secret:
        """What the robot is in a trial, by its number from 0."""
        begun = [number for number in self.changes if number <= trial]
        return self.changes[max(begun)] if begun else Secret(self.parameters, self.terms, self.values)

    def _log(self, states: np.ndarray, actions: np.ndarray, rate: float, name: str) -> Recording:
        told = np.concatenate([actions, actions[-1:]])[: len(states)]
        channels = [Channel(c.name, c.unit) for c in self.robot.file.channels]
        channels += [Channel(a.name, a.unit) for a in self.robot.file.actions]
        known = ~np.isnan(states).any(axis=1)
        time = np.arange(len(states))[known] / rate
        values = np.concatenate([states, told], axis=1)[known]
        return Recording(tuple(channels), (Episode(name, time, values),), measured=False)
