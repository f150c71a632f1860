"""The task of paper C: see the red target in the far corner of a walled field, and drive there.

The field, the trials and the fitness are the paper's. What it leaves open is ours: how far the target reaches, what a
wall does to a robot, the speeds behind the twenty commands, and where the rings of the sensor lie.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.timed.commands import pose_after
from dynreg.timed.pulsed import SPEEDS, Controllers

FIELD = np.array([2.4, 2.2])  # m
TARGET = np.array([2.05, 1.85])  # m, upper right
REACHED = 0.25  # m from it
START = np.array([0.4, 0.4])  # m, lower left
HEADINGS = np.array([0.5 * np.pi, 0.5 * np.pi, 0.0, 0.0])  # up and to the right, two trials of each
STEPS = 40
DRAWS = 2  # displacements of half a second in a step
ROBOT = 0.07  # m, its radius: no nearer to a wall
LEVELS = np.linspace(
    0.05, 0.14, SPEEDS
)  # m/s of a wheel: all drive on, or few controllers ever see the far corner
SECTORS = 16
RINGS = np.array([0.3, 0.7, 1.3])  # m: between four rings
# cells (n,) of commands, and of those before them (-1 at standstill), to displacements (n, 3) of half a second
Mover = Callable[[np.ndarray, np.ndarray], np.ndarray]


def seen(pose: np.ndarray) -> np.ndarray:
    """(n, 128) which inputs are on at poses (n, 3): 64 cells of the target's map, and 64 of the walls'.

    A map has 16 sectors, the first ahead, by four rings. Target and walls are tall: they fill the next ring, too.
    """
    target, walls = np.zeros((2, len(pose), SECTORS, len(RINGS) + 1), dtype=bool)
    away = TARGET - pose[:, :2]
    bearing = np.arctan2(away[:, 1], away[:, 0]) - pose[:, 2]
    each = np.arange(len(pose))
    sector = np.floor(np.mod(bearing / (2.0 * np.pi) * SECTORS + 0.5, SECTORS)).astype(int)
    _fill(target, each, sector, np.hypot(*away.T) - REACHED)
    every = np.arange(SECTORS)
    heading = pose[:, 2:] + 2.0 * np.pi * every / SECTORS
    _fill(walls, each[:, None], every, _to_wall(pose[:, None, :2], heading))
    return np.concatenate([target.reshape(len(pose), -1), walls.reshape(len(pose), -1)], axis=1)


def _fill(image: np.ndarray, which: np.ndarray, sector: np.ndarray, distance: np.ndarray) -> None:
    ring = np.searchsorted(RINGS, distance, side="right")
    image[which, sector, ring] = True
    image[which, sector, np.minimum(ring + 1, len(RINGS))] = True


def _to_wall(where: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """(n, S) metres from points (n, 1, 2) straight on, along headings (n, S) [rad], to a wall."""
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    room = np.where(direction > 0, FIELD - where, where)
    with np.errstate(divide="ignore"):
        return (room / np.abs(direction)).min(axis=-1)


@dataclass(frozen=True, eq=False)
class Trials:
    """What B controllers did in the four trials: whether they reached the target (B, 4), after how many steps (B, 4)
    (40 where they did not), and their ways (B, 4, 41, 3).
    """

    reached: np.ndarray
    steps: np.ndarray
    ways: np.ndarray

    @property
    def fitness(self) -> np.ndarray:
        """(B,) mean of 1 - steps / 40."""
        return (1.0 - self.steps / STEPS).mean(axis=1)


def tried(controllers: Controllers, mover: Mover) -> Trials:
    """Every controller in the four trials; `mover` says what commands do, in a model or on a robot."""
    many, each = len(controllers.thresholds), len(HEADINGS)
    pose = np.tile(np.concatenate([np.tile(START, (each, 1)), HEADINGS[:, None]], axis=1), (many, 1))
    drives = controllers.take(np.repeat(np.arange(many), each))
    reached, steps = np.zeros(many * each, dtype=bool), np.full(many * each, STEPS)
    before = np.full(many * each, -1)
    ways = np.empty((many * each, STEPS + 1, 3))
    ways[:, 0] = pose
    for step in range(1, STEPS + 1):
        going = np.flatnonzero(~reached)
        if len(going):
            told = drives.take(going).commands(seen(pose[going]))
            cell = told[:, 0] * SPEEDS + told[:, 1]
            pose[going] = _moved(pose[going], cell, before[going], mover)
            before[going] = cell
            there = going[np.linalg.norm(pose[going, :2] - TARGET, axis=1) <= REACHED]
            reached[there], steps[there] = True, step
        ways[:, step] = pose
    shape = (many, each)
    return Trials(reached.reshape(shape), steps.reshape(shape), ways.reshape(*shape, STEPS + 1, 3))


def _moved(pose: np.ndarray, cell: np.ndarray, before: np.ndarray, mover: Mover) -> np.ndarray:
    """(n, 3) poses after a step; at a wall the robot slides along it."""
    for _ in range(DRAWS):
        pose = pose_after(pose, mover(cell, before))
        pose[:, :2] = np.clip(pose[:, :2], ROBOT, FIELD - ROBOT)
        before = cell
    return pose


def cells() -> tuple[np.ndarray, np.ndarray]:
    """(400,) speeds [m/s] of the left and the right wheel in every cell."""
    left, right = np.divmod(np.arange(SPEEDS**2), SPEEDS)
    return LEVELS[left], LEVELS[right]
