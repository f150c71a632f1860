"""Windows made by hand: measured motion, commands and inputs of a packaged robot, as a recording would be cut."""

import numpy as np

from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run


def windows_of(
    robot: Robot,
    measured: np.ndarray,
    actions: np.ndarray,
    *,
    inputs: np.ndarray | None = None,
    settings: np.ndarray | None = None,
    begin: np.ndarray | None = None,
    period: float = 0.01,
) -> Windows:
    """Windows of measured states (W, T+1, S) under actions (W, T, A), each an episode of its own."""
    count, rows = measured.shape[:2]
    if inputs is None:
        inputs = np.tile(robot.input_defaults, (count, rows - 1, 1))
    if settings is None:
        settings = np.tile([s.nominal for s in robot.file.settings], (count, 1))
    run = Run(actions, inputs=inputs, settings=settings, initial=measured[:, 0], period=period, begin=begin)
    weight = np.array([c.weight for c in robot.file.channels])
    weight = weight * np.isfinite(measured).any(axis=(0, 1))
    spread = np.array(
        [np.std(c[np.isfinite(c)]) if np.isfinite(c).any() else 1.0 for c in np.moveaxis(measured, 2, 0)]
    )
    numbers = np.arange(count)
    cut = np.stack([np.zeros(count, int), np.full(count, rows)], axis=1)
    return Windows(run, measured, np.maximum(spread, 1e-9), weight / weight.sum(), numbers, cut, period)


def triangle(rows: int, *, speed: float = 2.0, half: int = 50, period: float = 0.01) -> np.ndarray:
    """(rows, 2) position and velocity that reverses every `half` rows."""
    velocity = speed * np.where(np.arange(rows) // half % 2 == 0, 1.0, -1.0)
    position = np.concatenate([[0.0], np.cumsum(velocity[:-1]) * period])
    return np.stack([position, velocity], axis=1)


def swing(rows: int, *, rate: float = 6.0, size: float = 0.5, period: float = 0.01) -> np.ndarray:
    """(rows, 2) position and velocity of a sine."""
    t = np.arange(rows) * period
    return np.stack([size * np.sin(rate * t), size * rate * np.cos(rate * t)], axis=1)
