"""What a robot on wheels moved in pieces of half a second, and what simulators move in their place."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynreg.data.names import piece_of
from dynreg.errors import LogError, SimulationError
from dynreg.replay.data import Data
from dynreg.replay.velocity import pose_columns
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import Case, rollouts
from dynreg.timed.cells import NEAR, Grid, mean_by_cell
from dynreg.timed.commands import AXES, displacement
from dynreg.timed.wheels import wheels_of

SAMPLE = 0.5  # s of a piece (paper C)
LEAST = 1e-6  # m/s between the slowest and the fastest wheel: the same is told all the time


@dataclass(frozen=True, eq=False)
class Displaced:
    """n pieces of the windows of a recording that are not held out, in the order in which they were driven.

    window, begin, end : (n,) number of the window, and rows in it. turn : (n,) number of the episode, from 0; of the
    window where the recording was parted by windows. speeds : (n, 2) what the left and the right wheel were told on
    average [m/s]. moved : (n, 3) what the robot did meanwhile [m, m, rad].
    """

    data: Data
    window: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    turn: np.ndarray
    speeds: np.ndarray
    moved: np.ndarray

    @property
    def turns(self) -> tuple[tuple[str, str], ...]:
        """(name, its episode) of each turn."""
        cut, named, by_windows = self.data.windows, [], _by_windows(self.data)
        for window in self.window[np.unique(self.turn, return_index=True)[1]].tolist():
            episode = self.data.recording.episodes[cut.episode[window]].name
            before = int((cut.episode[:window] == cut.episode[window]).sum())
            named.append((piece_of(episode, before) if by_windows else episode, episode))
        return tuple(named)

    def take(self, which: np.ndarray) -> "Displaced":
        """Some of the pieces (a mask)."""
        columns = ("window", "begin", "end", "turn", "speeds", "moved")
        return Displaced(self.data, *(getattr(self, name)[which] for name in columns))

    def grid(self, each: int) -> Grid:
        """Cells of all speeds that were told."""
        low = float(self.speeds.min())
        return Grid(low, max(float(self.speeds.max()), low + LEAST), each)


@dataclass(frozen=True, eq=False)
class Samples:
    """Pieces in the cells of a grid; pieces in a row of one cell are one sample, for they share poses.

    cell : (s,) of each sample. of : (n,) number of the sample of each piece. turn : (s,).
    """

    grid: Grid
    cell: np.ndarray
    of: np.ndarray
    turn: np.ndarray

    @classmethod
    def cut(cls, pieces: Displaced, each: int) -> "Samples":
        grid = pieces.grid(each)
        own = grid.cell(*pieces.speeds.T)
        new = np.ones(len(own), dtype=bool)
        new[1:] = (own[1:] != own[:-1]) | (pieces.window[1:] != pieces.window[:-1])
        return cls(grid, own[new], np.cumsum(new) - 1, pieces.turn[new])

    def until(self, turn: int) -> "Samples":
        """Those of the turns to this one."""
        seen = self.turn <= turn
        return Samples(self.grid, self.cell[seen], self.of[seen[self.of]], self.turn[seen])

    def mean(self, values: np.ndarray) -> np.ndarray:
        """(s, 3) of values (n, 3) of the pieces."""
        return mean_by_cell(len(self.cell), self.of, values)


@dataclass(eq=False)
class Simulators:
    """Simulators of a robot on wheels in the place of the robot, and what they cost.

    threads : of simulations. ran : simulators so far. seconds : that they simulated.
    """

    data: Data
    threads: int = 0
    ran: int = field(default=0)
    seconds: float = field(default=0.0)

    def moved(self, pieces: Displaced, values: np.ndarray, effects: Mapping[str, np.ndarray]) -> np.ndarray:
        """(B, n, 3) what simulators with parameters (B, P) move in the pieces; effects : (B, K) values of each."""
        windows, at = np.unique(pieces.window, return_inverse=True)
        run = self.data.windows.run.take(windows)
        terms = Terms(tuple(term(key) for key in effects), tuple(effects.values())) if effects else None
        (found,) = rollouts(self.data.robot, [Case(values, run, terms)], threads=self.threads)
        self.ran += len(values)
        self.seconds += len(values) * run.episodes * run.steps * self.data.windows.period
        pose = found.states[..., pose_columns(self.data.robot)]
        if not np.isfinite(pose).all():
            raise SimulationError(
                f"a simulator of {self.data.robot.name!r} diverges under the recording's commands",
                expected="parameters with which all of its episodes can be simulated",
                do="narrow the ranges of [[parameters]] in robot.toml, or take a shorter time step",
            )
        first, last = pose[:, at, pieces.begin], pose[:, at, pieces.end]
        flat = displacement(first.reshape(-1, len(AXES)), last.reshape(-1, len(AXES)))
        return flat.reshape(first.shape)


def off(moved: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """(..., 3) what was moved more than simulated; turns the shorter way round."""
    apart = moved - simulated
    apart[..., 2] = (apart[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return apart


def displaced(data: Data) -> Displaced:
    """Pieces of the windows that are not held out.

    A piece is from one measured pose to the next that is `SAMPLE` [s] later, at most a fifth more. Raises LogError
    where there is none.
    """
    cut, steps = data.windows, max(round(SAMPLE / data.windows.period), 1)
    columns = pose_columns(data.robot)
    parts = []
    for window in data.parts.chosen:
        known = np.flatnonzero(np.isfinite(cut.measured[window][:, columns]).all(axis=1))
        parts += [(window, *rows) for rows in _cut(known, steps)]
    if not parts:
        raise LogError(
            f"no two poses of {data.robot.name!r} were measured about {SAMPLE:g} s apart",
            expected="the pose of the base all the time",
            do="log it more often, or take another method",
        )
    window, begin, end = np.array(parts).T
    told = wheels_of(data.robot, data.robot.actions).speeds
    speeds = np.array([told(cut.run.actions[w, b:e]).mean(axis=0) for w, b, e in parts])
    poses = cut.measured[..., columns]
    moved = displacement(poses[window, begin], poses[window, end])
    turn = np.unique(window if _by_windows(data) else cut.episode[window], return_inverse=True)[1]
    return Displaced(data, window, begin, end, turn, speeds, moved)


def _by_windows(data: Data) -> bool:
    """Whether windows take turns, as they do in `replay.parts.parts` where there are few episodes."""
    episode = data.windows.episode
    return len(np.unique(episode)) < 4 <= len(episode)


def _cut(known: np.ndarray, steps: int) -> list[tuple[int, int]]:
    """(begin, end) of pieces about so many steps long, of rows (n,) with a pose."""
    out, begin = [], None
    for row in known.tolist():
        if begin is not None and row - begin < steps:
            continue
        if begin is not None and row - begin <= (1.0 + NEAR) * steps:
            out.append((begin, row))
        begin = row
    return out
