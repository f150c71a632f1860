"""Logs that something has happened to."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynreg.data.recording import Episode, Recording


def edited(recording: Recording, edit: Callable[[int, np.ndarray], object]) -> Recording:
    """The recording with `edit(number, values)` done to a copy of each episode's values (T, C)."""
    episodes = []
    for number, e in enumerate(recording.episodes):
        values = e.values.copy()
        edit(number, values)
        episodes.append(Episode(e.name, e.time, values, e.settings))
    return replace(recording, episodes=tuple(episodes))
