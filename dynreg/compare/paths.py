"""Commands in a row: where predictions end that begin at a measured pose, and what a figure shows of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dynreg.compare.contenders import Predicts
from dynreg.data.recording import Recording
from dynreg.timed.commands import chained, pose_after
from dynreg.timed.compare import Spread, spread
from dynreg.timed.task import COMMANDS
from dynreg.timed.told import SAME, Told

SHOWN = 4  # runs that are drawn
SHARES = (0.25, 0.5, 0.75, 1.0)  # a drawn path has a point at these shares of each command's time
CM = 100.0


@dataclass(frozen=True)
class Paths:
    """How far apart measured and predicted positions are after `commands` commands in a row, over `runs` such runs."""

    runs: int
    commands: int
    models: Mapping[str, Spread]


@dataclass(frozen=True)
class Way:
    """Points of a path on the ground [m]; None where a model says no number, or where the place was not measured."""

    x: tuple[float | None, ...]
    y: tuple[float | None, ...]


@dataclass(frozen=True)
class DrivenPath:
    """One run of commands: the measured way and each model's, at the same times.

    begin, seconds : on the episode's clock, and how long it lasted.
    """

    episode: str
    begin: float
    seconds: float
    measured: Way
    models: Mapping[str, Way]


def runs(told: Told, first: int) -> np.ndarray:
    """(R, 10) commands from number `first` on that follow each other without a gap, in runs that share none."""
    out, begin, follows = [], first, told.follows
    for at in range(first, len(told.commands)):
        if at > begin and not follows[at]:
            begin = at
        if at - begin + 1 == COMMANDS:
            out.append(np.arange(begin, at + 1))
            begin = at + 1
    return np.array(out, dtype=int).reshape(-1, COMMANDS)


def ends(told: Told, contenders: Mapping[str, Predicts], runs: np.ndarray) -> Paths | None:
    """How far from the measured end of runs (R, 10) each prediction is; None without a run."""
    if not len(runs):
        return None
    start = told.start[runs[:, 0]]
    there = _end(told.moved, start, runs)
    off = {}
    for name, contender in contenders.items():
        flat = contender.moved(runs.ravel())
        found = _end(flat, start, np.arange(runs.size).reshape(runs.shape))
        off[name] = CM * np.hypot(*(found - there)[:, :2].T)
    return Paths(
        runs=len(runs), commands=COMMANDS, models={name: spread(miss, "cm") for name, miss in off.items()}
    )


def _end(moved: np.ndarray, start: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """(R, 3) poses after displacements of runs (R, 10), from poses (R, 3)."""
    pose = start
    for step in runs.T:
        pose = pose_after(pose, moved[step])
    return pose


def driven(
    told: Told,
    recording: Recording,
    pose: tuple[str, ...],
    contenders: Mapping[str, Predicts],
    runs: np.ndarray,
) -> tuple[DrivenPath, ...]:
    """Some of the runs (R, 10), evenly: the measured way and each prediction's."""
    out = []
    for i in np.unique(np.linspace(0, len(runs) - 1, min(SHOWN, len(runs))).round().astype(int)):
        run, start = runs[i], told.start[runs[i, 0]]
        episode = recording.episodes[told.episode[run[0]]]
        begin, end = told.begin[run], told.end[run]
        within = begin[:, None] + np.array(SHARES) * (end - begin)[:, None]
        times = np.concatenate([begin[:1], within.ravel()])
        values = episode.values[:, recording.columns(pose[:2])]
        longest = np.append(end[0] - begin[0], np.repeat(end - begin, len(SHARES)))
        out.append(
            DrivenPath(
                episode=episode.name,
                begin=float(begin[0]),
                seconds=float(end[-1] - begin[0]),
                measured=_way(*(_known(times, longest, episode.time, column) for column in values.T)),
                models={name: _way(*_predicted(c, run, start)) for name, c in contenders.items()},
            )
        )
    return tuple(out)


def _known(times: np.ndarray, longest: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at times (n,), between those that were measured: a camera may be slower than the log.

    NaN in gaps that are longer than `longest` (n,) [s], and before the first or after the last that was measured.
    """
    known = np.isfinite(values)
    seen = stamps[known]
    after = np.searchsorted(seen, times - SAME)  # the first that is not before
    inside = after < len(seen)
    last = np.minimum(after, len(seen) - 1)
    at = np.abs(seen[last] - times) <= SAME
    gap = seen[last] - seen[np.maximum(last - 1, 0)]
    between = inside & (after > 0) & (gap <= longest + SAME)
    return np.where(inside & at | between, np.interp(times, seen, values[known]), np.nan)


def _predicted(contender: Predicts, run: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(2, 1 + 10 S) x and y at the start and at every share of each command."""
    at = np.stack([contender.moved(run, share) for share in SHARES], axis=1)  # (10, S, 3)
    poses = chained(at[:, -1], start)
    points = pose_after(poses[:-1, None], at).reshape(-1, 3)
    return np.concatenate([start[None], points])[:, :2].T


def _way(*axes: np.ndarray) -> Way:
    return Way(*(tuple(float(f"{v:.6g}") if np.isfinite(v) else None for v in axis) for axis in axes))
