"""Gaits on several simulators at once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dynreg.errors import RobotError
from dynreg.gait.family import Family
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Task
from dynreg.rng import stream, stream_seed
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Terms, stacked
from dynreg.sim.engine import engines_with
from dynreg.sim.engines import Arena
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run, Walk, motor_noise

if TYPE_CHECKING:
    from mujoco import MjModel

TURNS = range(1_000, 10_000)  # draws of simulators that take turns; after so many batches they come again
# Commands in a period of the fastest gait, below which what is told is not the gait: our own choice.
LEAST_RATE = 4.0


@dataclass(frozen=True, eq=False)
class Simulators:
    """k simulators of one robot: values (k, P) and their effects."""

    values: np.ndarray
    terms: Terms | None = None

    def __len__(self) -> int:
        return len(self.values)

    def take(self, numbers: Sequence[int]) -> "Simulators":
        """Some of them."""
        return Simulators(self.values[list(numbers)], self.terms and self.terms.take(list(numbers)))


def simulators_of(robot: Robot, configs: Sequence[SimConfig], known: np.ndarray | None = None) -> Simulators:
    """The simulators of configurations, all with the parameters (P,) that are known of the real robot (not NaN)."""
    values = np.array([robot.space.from_dict(dict(config.values)) for config in configs])
    if known is not None:
        values = np.where(np.isnan(known), values, known)
    own = (([i], terms_of(config, robot)) for i, config in enumerate(configs))
    return Simulators(values, stacked(len(configs), own))


class Trials:
    """Runs gaits in k simulators; counts the runs.

    rate : commands a second [Hz]. Every simulator draws its motor noise once, the same for all gaits, so that
    gaits are compared and not their luck; a `draw` above 0 is another noise; `noise` (k, 1, T, A) stands in place of
    the first. Raises RobotError where the robot cannot walk or commands are too rare.
    """

    def __init__(
        self,
        robot: Robot,
        task: Task,
        simulators: Simulators,
        *,
        rate: float,
        seed: int = 0,
        threads: int = 0,
        noise: np.ndarray | None = None,
    ):
        if not any(engine.contacts for engine in robot.engines.values()):
            raise RobotError(
                f"robot {robot.name!r} has no engine {' or '.join(map(repr, engines_with('contacts')))}",
                expected="walking robots to name it in robot.toml",
                do="add it to `engines`",
            )
        self.space: Family = gait_space(robot, task.motion)
        fastest = self.space.fastest
        if rate < LEAST_RATE * fastest:
            raise RobotError(
                f"{rate:.3g} commands a second for gaits of up to {fastest:g} Hz",
                expected=f"at least {LEAST_RATE * fastest:g} Hz",
                do="lower the frequency of [gait], or command the robot more often",
            )
        self.robot, self.task, self.simulators, self.rate = robot, task, simulators, rate
        self.rollouts = self.physics_steps = 0
        self._threads, self._seed = threads, seed
        self.times = np.arange(max(round(task.seconds * rate), 1)) / rate
        self._noise = self._drawn(0) if noise is None else noise
        self._arenas: dict[int, Arena] = {}

    def walk(self, genes: np.ndarray, *, feet: bool = False, draw: int = 0) -> Walk:
        """What gaits (n, G) do in every simulator: (k, n); with `feet`, which of them touch the ground when."""
        run = self._run(genes, draw)
        if len(genes) not in self._arenas:
            self._arenas = {len(genes): self._arena(run)}
        walk = self._arenas[len(genes)].walk(run, feet=feet)
        self.rollouts += len(genes) * len(self.simulators)
        self.physics_steps += walk.physics_steps
        return walk

    def grades(self, genes: np.ndarray, draw: int = 0) -> np.ndarray:
        """(n, k) of gaits (n, G); see `Task.grade`."""
        return self.task.grade(self.walk(genes, draw=draw)).T

    def again(
        self,
        genes: np.ndarray,
        draws: int,
        *,
        first: int = 0,
        doubt: float = 0.0,
        moved: int | None = None,
        only: Sequence[int] | None = None,
    ) -> np.ndarray:
        """(n, draws, k) grades of gaits (n, G) with other draws of every simulator's motor noise.

        first : draws with lower numbers were seen before. doubt : 1 sigma, as a share of the ranges, by which every
        draw moves the parameters that the lab does not know, too. moved : the first of the draws whose moves are made
        instead; two calls with the same `moved` differ in noise alone. only : numbers of the k simulators in which they
        run; by default in all.
        """
        only = range(len(self.simulators)) if only is None else only
        simulators = self.simulators.take(only)
        k, space = len(simulators), self.robot.space
        terms = simulators.terms and simulators.terms.tiled(draws)
        values = np.tile(simulators.values, (draws, 1))
        seeds = self._seeds(first, draws)
        if doubt:
            all_of_them = (len(self.simulators), len(space))  # one does what it does beside others
            of_moves = seeds if moved is None else self._seeds(moved, draws)
            moves = [stream(s, "doubt").standard_normal(all_of_them)[list(only)] for s in of_moves]
            unit = space.to_unit(values)
            # what lies outside the ranges is there on purpose, and must not be drawn into them
            stays = np.array([p.known for p in space.parameters]) | (unit < 0.0) | (unit > 1.0)
            values = np.where(stays, values, space.from_unit(unit + doubt * np.concatenate(moves)))
        other = Trials(
            self.robot,
            self.task,
            Simulators(values, terms),
            rate=self.rate,
            threads=self._threads,
            noise=np.concatenate([self._drawn(s)[list(only)] for s in seeds]),
        )
        found = other.grades(genes)
        self.rollouts += other.rollouts
        self.physics_steps += other.physics_steps
        return found.reshape(len(genes), draws, k)

    def turn(self, batch: int, each: int) -> list[int]:
        """Numbers of the `each` simulators, of k, that a batch of this number, from 0, meets: none of them twice.

        Batches go through all k in one drawn order, again and again. Where a batch and a pass end together, another
        order is drawn.
        """
        k = len(self.simulators)
        whole = math.lcm(k, each)
        places = range(batch * each, (batch + 1) * each)
        return [int(self._order(at // whole)[at % k]) for at in places]

    def in_turn(self, genes: np.ndarray, batch: int, each: int, doubt: float) -> np.ndarray:
        """(n, each) grades of a batch of gaits (n, G) in the simulators whose turn it is, with noise of its own.

        So a gait costs `each` runs, however many simulators there are. doubt : see `again` (domain randomisation: Tobin
        et al., arXiv 1703.06907).
        """
        return self.again(
            genes, 1, first=TURNS[batch % len(TURNS)], doubt=doubt, only=self.turn(batch, each)
        )[:, 0]

    def poses(self, actions: np.ndarray, simulator: int) -> "tuple[MjModel, np.ndarray]":
        """The MuJoCo model of a simulator (its number), and its poses (T+1, nq) under joint commands (T, A)."""
        run = Run(actions[None], period=1.0 / self.rate, noise=self._noise)
        arena = self._arena(run)
        return arena.model(simulator), arena.poses(run)[simulator, 0]

    def _seeds(self, first: int, draws: int) -> list[int]:
        return [stream_seed(self._seed, "again", first + d) % 2**62 for d in range(draws)]

    def _order(self, number: int) -> np.ndarray:
        return stream(self._seed, "gait turns", number).permutation(len(self.simulators))

    def _drawn(self, draw: int) -> np.ndarray:
        """(k, 1, T, A) motor noise."""
        which = ("gait noise", draw) if draw else ("gait noise",)
        seeds = np.array([stream_seed(self._seed, *which, i) % 2**62 for i in range(len(self.simulators))])
        return motor_noise(seeds, 1, len(self.times), len(self.robot.actions))

    def _run(self, genes: np.ndarray, draw: int) -> Run:
        actions = self.space.targets(genes, self.times)
        noise = self._drawn(draw) if draw else self._noise
        return Run(
            actions, period=1.0 / self.rate, noise=np.broadcast_to(noise, (len(noise), *actions.shape))
        )

    def _arena(self, run: Run) -> Arena:
        return Arena(
            self.robot,
            self.simulators.values,
            run,
            threads=self._threads,
            terms=self.simulators.terms,
            slope=self.task.slope(),
            laid=self.task.laid(),
        )
