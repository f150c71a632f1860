"""Trajectory distance: the recording against each entry's stored run of the same commands."""

from collections.abc import Mapping

import numpy as np

from dynreg.distance.query import DistanceQuery, Ranked, in_order
from dynreg.errors import LogError, UsageError

ALIKE = 1e-3  # of the commands' range: what commands that were stored and logged may differ by


def rank(asked: DistanceQuery) -> Ranked:
    """Entries by this distance; needs their states. Raises as `trajectory`, for channels that were logged."""
    recording, robot, states = asked.recording, asked.robot, asked.population.entries.states
    logged = [column for column, name in enumerate(robot.channels) if name in recording.names]
    own = recording.columns([robot.channels[column] for column in logged])
    told = recording.columns(robot.actions)
    episodes = {e.name: (e.values[:, own], e.values[:-1, told]) for e in recording.episodes}
    spread = states.reshape(-1, states.shape[-1]).std(axis=0) + 1e-9
    every = trajectory(states[..., logged], asked.population.shared.run.actions, episodes, spread[logged])
    return in_order(asked.allowed, every[asked.allowed], len(every))


def trajectory(
    states: np.ndarray,
    actions: np.ndarray,
    episodes: Mapping[str, tuple[np.ndarray, np.ndarray]],
    spread: np.ndarray,
) -> np.ndarray:
    """(M,) mean absolute difference, in units of each channel's spread: of each episode, then of all.

    An episode may be a piece of a run that begins on the way, or go on after it. Where its commands stand in several
    places, each entry's nearest counts.

    Parameters
    ----------
    states : (M, E, T+1, S) what the entries did under the bank's commands.
    actions : (E, T, A) the bank's commands.
    episodes : by name what the robot did (t+1, S), NaN where that is not known, and what it was told (t, A).
    spread : (S,) unit of each channel.

    Raises UsageError where an episode's commands are none of the bank's, LogError where nothing was measured.
    """
    apart = []
    for name, (measured, told) in episodes.items():
        told = told[: actions.shape[1]]
        rows = measured[: len(told) + 1]
        known = np.isfinite(rows)
        if not len(told) or not known.any():
            continue
        each = []
        for run, first in _places(actions, told, name):
            difference = np.abs(states[:, run, first : first + len(rows)] - rows) / spread
            each.append(np.nanmean(np.where(known, difference, np.nan), axis=(1, 2)))
        apart.append(np.min(each, axis=0))
    if not apart:
        raise LogError(
            "no episode has two rows and a measured state",
            expected="measured states under the population's commands",
            do="log the robot's channels, or correct their sources in the map",
        )
    return np.mean(apart, axis=0)


def _places(actions: np.ndarray, told: np.ndarray, episode: str) -> list[tuple[int, int]]:
    """Runs and rows of the bank's commands (E, T, A) from which on they are these (t, A): a held one has several."""
    windows = np.lib.stride_tricks.sliding_window_view(actions, len(told), axis=1)  # (E, T-t+1, A, t)
    apart = np.stack([np.abs(run - told.T).max(axis=(1, 2)) for run in windows])
    found = np.argwhere(apart <= ALIKE * max(np.ptp(actions), 1e-12))  # NaN is no match
    if not len(found):
        raise UsageError(
            f"--distance trajectory and episode {episode!r}, whose commands the population's simulators did not run",
            expected="a recording of the commands that these simulators ran (those of [excitation] in robot.toml)",
            do="leave --distance out, or run the commands of one of the population's episodes on the robot",
        )
    return [(int(run), int(row)) for run, row in found]
