"""Motor noise: how far commands are off at random, told by what the best simulator leaves from row to row.

No fit sees it, for a rollout without noise is what a fit compares. But a gait that was sought with less noise than the
robot has falls there.
"""

from dataclasses import replace

import numpy as np

from dynreg.replay.windows import Windows
from dynreg.rng import stream_seed
from dynreg.sim.effects import Terms
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import motor_noise

DRAWS = 4  # rollouts with noise
ROUNDS = 3
LEAST = 1e-4  # of the square, in one round: none at all could not grow again
SEEN = 1.0  # times the sensor's own noise that noise in the commands must move a channel from row to row, to count
NORMAL = 0.6745  # median of the absolute value of a standard normal variable


def jitter(
    robot: Robot,
    windows: Windows,
    values: np.ndarray,
    terms: Terms | None,
    chosen: np.ndarray,
    *,
    engine: str | None = None,
    threads: int = 1,
    seed: int = 0,
) -> tuple[np.ndarray, int]:
    """(P,) `values` with the motor noise that the log tells, and how many simulators were run through the windows.

    They are `values` themselves where the robot has no such noise, or nothing tells it.

    values : (P,) of the best simulator. terms : its effects, of one row. chosen : windows to look at.

    Scatter is measured by medians of differences from row to row: what drifts or slips is in few of them. In the log
    it is the residual's; with the noise in the middle of its range it is that of simulations with and without it.
    The ratio of the squares, less the sensor's, is the noise's: what is small adds up so. Median over channels; again
    with the noise that was found, for drives that saturate scatter less.
    """
    at = [i for i, s in enumerate(robot.setters) if any((a.root, a.path) == ("control", "noise") for a in s)]
    if not at:
        return values, 0
    low, high = robot.space.bounds[at[0]]
    run = windows.run.take(chosen)
    seeds = np.array([stream_seed(seed, "jitter", i) % 2**62 for i in range(DRAWS + 1)])
    run = replace(run, noise=motor_noise(seeds, run.episodes, run.steps, len(robot.actions)))
    every = terms and terms.tiled(len(seeds))
    rows, sensor = np.tile(values, (len(seeds), 1)), np.sqrt(2.0) * robot.sensor_noise
    found, ran = 0.5 * (low + high), 0
    for already in range(ROUNDS):
        rows[:, at] = found
        rows[0, at] = 0.0
        states = rollout(robot, rows, run, engine=engine, threads=threads, terms=every).states
        ran += len(rows)
        left = _scatter(states[:1] - windows.measured[chosen])
        made = _scatter(states[1:] - states[:1])
        telling = (windows.weight > 0) & (made > SEEN * sensor) & np.isfinite(left)
        if not telling.any():
            if not already:  # not even the middle of the range moves a channel
                return values, ran
            break  # what was found is too small to tell any better
        square = np.median((left[telling] ** 2 - sensor[telling] ** 2) / made[telling] ** 2)
        found = float(np.clip(found * np.sqrt(max(square, LEAST)), low, high))
    out = values.copy()
    out[at] = found
    return out, ran


def _scatter(states: np.ndarray) -> np.ndarray:
    """(S,) standard deviation of differences from row to row of (n, W, T, S), by their median size."""
    steps = np.abs(np.diff(states, axis=2)).reshape(-1, states.shape[-1])
    with np.errstate(invalid="ignore"):
        known = np.isfinite(steps).any(axis=0)
        return np.where(known, np.nanmedian(np.where(known, steps, 0.0), axis=0), np.nan) / NORMAL
