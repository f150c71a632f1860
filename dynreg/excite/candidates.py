"""Candidate commands for an experiment: patterns at several reaches, kept within what the robot allows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dynreg.excite.limits import Limits, Span
from dynreg.rng import stream
from dynreg.sim.excitation import KINDS, targets
from dynreg.sim.ports import nominal_ports
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

RANDOM_REACHES = (0.3, 0.8)

Wave = Callable[[np.ndarray, float], np.ndarray]  # times (T, 1) [s], duration [s] -> offsets in [-1, 1]


@dataclass(frozen=True)
class Pool:
    """Candidates: episodes of equal length that begin at rest in the reset pose, and what each is called.

    Targets end in the reset pose, too.
    """

    names: tuple[str, ...]
    run: Run

    def __len__(self) -> int:
        return len(self.names)

    def take(self, chosen: np.ndarray) -> "Pool":
        """Only these candidates (numbers)."""
        return Pool(tuple(self.names[i] for i in chosen), self.run.take(np.asarray(chosen)))

    def with_settings(self, settings: np.ndarray) -> "Pool":
        """Every candidate with every row of settings (M, K), those of one candidate next to each other."""
        many = len(settings)
        run = self.run.take(np.repeat(np.arange(len(self)), many))
        return Pool(
            tuple(name for name in self.names for _ in range(many)),
            Run(run.actions, run.inputs, np.tile(settings, (len(self), 1)), period=run.period),
        )


def both(first: Pool, second: Pool) -> Pool:
    """The candidates of two pools."""
    runs = (first.run, second.run)
    actions, inputs, settings = (
        np.concatenate([getattr(run, k) for run in runs]) for k in ("actions", "inputs", "settings")
    )
    run = Run(actions, inputs=inputs, settings=settings, period=first.run.period)
    return Pool((*first.names, *second.names), run)


def pool(robot: Robot, limits: Limits, joints: tuple[str, ...], steps: int, seed: int) -> Pool:
    """Candidates of `steps` commands that move `joints` (all where none is named), at nominal settings.

    Slow triangles, reversals, chirps, steps and holds, small ones of targets also away from the reset pose; the random
    kinds of the usual excitation; a hold that the drives of targets leave, where they can be switched off alone.
    """
    rate = robot.rate
    moving = np.isin(np.arange(len(robot.joints)), robot.drives_of(joints))
    span = Span.of(robot, moving)
    names, actions = [], []
    for name, offsets in _offsets(robot, steps, rate, moving, seed):
        names.append(name)
        actions.append(span.commands(offsets, limits, 1.0 / rate))
    inputs = np.tile(robot.input_defaults, (len(names), steps, 1))
    dropping = [i for i, name in enumerate(names) if name.startswith("drop")]
    inputs[np.ix_(dropping, np.arange(steps // 2, steps), _dropped(robot, moving))] = 0.0
    nominal = np.tile([s.nominal for s in robot.file.settings], (len(names), 1))
    run = Run(np.array(actions), inputs=inputs, settings=nominal, period=1.0 / rate)
    return Pool(tuple(names), run)


def _dropped(robot: Robot, moving: np.ndarray) -> np.ndarray:
    """Columns of the inputs that switch off targets that move (A,), and no drive of a joint that is to hold still."""
    enables = nominal_ports(robot, 1).enable_input
    return np.setdiff1d(enables[moving & targets(robot) & (enables >= 0)], enables[~moving])


def _offsets(
    robot: Robot, steps: int, rate: float, moving: np.ndarray, seed: int
) -> Iterator[tuple[str, np.ndarray]]:
    """(name, (T, A) offsets as `Span.commands` takes them) of every candidate."""
    t, count = np.arange(steps)[:, None] / rate, int(moving.sum())
    duration = steps / rate
    standing = robot.floating  # it leaves its pose as little as it can
    size = robot.file.excitation.amplitude if standing else 1.0
    held = targets(robot)  # a torque or a speed away from zero would drive its joint ever further
    apart = stream(seed, "excite", robot.name, "phases").uniform(0.0, 1.0, len(moving))
    for name, wave, period, reaches in _waves(rate, duration):
        for reach, centre in reaches:
            if centre and (standing or not (moving & held).any()):
                continue
            for phase, how in ((0.0, ""), (apart, ", joints apart"))[: 2 if count > 1 else 1]:
                shape = wave(t + period * phase, duration) * np.ones(len(moving))
                where = f", around {centre:+g}" if centre else ""
                yield f"{name}, reach {reach:g}{where}{how}", moving * size * (centre * held + reach * shape)
    for kind in ("levels", "walk", "gait"):
        for i, reach in enumerate(RANDOM_REACHES):
            rng = stream(seed, "excite", robot.name, kind, i)
            yield (
                f"{kind}, reach {reach:g}",
                moving * size * reach * KINDS[kind](rng, steps, len(moving), rate),
            )
    if len(_dropped(robot, moving)):
        for side in (-1.0, 1.0):
            for reach in RANDOM_REACHES:
                yield f"drop from {side * reach:+g}", np.tile(moving * held * size * side * reach, (steps, 1))


def _waves(rate: float, duration: float) -> list[tuple[str, Wave, float, list[tuple[float, float]]]]:
    """(name, wave, the period by which joints are shifted [s], its (reach, centre) pairs)."""
    fast = min(10.0, rate / 8)
    off = [(0.2, -0.5), (0.2, 0.5)]
    small = [(0.05, 0.0), (0.05, 0.5), (0.05, -0.5), (0.2, 0.0), *off]
    return [
        ("triangle of 4 s", triangle(4.0), 4.0, [(0.2, 0.0), *off, (0.5, 0.0), (0.9, 0.0)]),
        ("triangle of 2 s", triangle(2.0), 2.0, [(0.05, 0.0), (0.2, 0.0), *off, (0.5, 0.0), (0.9, 0.0)]),
        ("reversals of 0.6 s", square(0.6), 0.6, small),
        ("reversals of 0.25 s", square(0.25), 0.25, small),
        (f"chirp to {fast:.3g} Hz", chirp(0.3, fast), 1.0, [*small, (0.5, 0.0)]),
        (f"chirp to {fast / 4:.3g} Hz", chirp(0.2, fast / 4), 2.0, [*small, (0.5, 0.0), (0.9, 0.0)]),
        ("steps of 0.6 s", square(1.2), 1.2, [(0.5, 0.0), (0.9, 0.0)]),
        ("holds", _staircase, 0.5 * duration, [(0.2, 0.0), *off, (0.5, 0.0), (0.9, 0.0)]),
    ]


def triangle(period: float) -> Wave:
    """A triangle of this period [s] that sets out from 0."""
    return lambda t, duration: 4 * np.abs((t / period + 0.25) % 1 - 0.5) - 1


def square(period: float) -> Wave:
    """Steps to and fro, once in this time [s]."""
    return lambda t, duration: np.where((t / period) % 1 < 0.5, 1.0, -1.0)


def chirp(low: float, high: float) -> Wave:
    """A sine whose frequency rises from `low` to `high` [Hz] over the whole duration."""
    return lambda t, duration: np.sin(2 * np.pi * (low * t + (high - low) * t**2 / (2 * duration)))


def _staircase(t: np.ndarray, duration: float) -> np.ndarray:
    levels = np.array([0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0])
    return levels[np.floor(8 * t / duration).astype(int) % 8]
