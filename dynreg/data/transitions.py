"""Rows (state, action, next state) of a Recording: what dynamics models learn from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import LogError, one_of


@dataclass(frozen=True)
class Transitions:
    """One row a control step; float32.

    states (N, S), actions (N, A), context (N, K), next_states (N, S); `episode` (N,) int numbers the
    recording's episodes, so that rows can be held out by trajectory. Rows of a data set also tell `entry` (N,) int,
    which of its entries each one is of, and `period` (N,) [s], NaN where nobody told it; None elsewhere.
    """

    states: np.ndarray
    actions: np.ndarray
    context: np.ndarray
    next_states: np.ndarray
    episode: np.ndarray
    entry: np.ndarray | None = None
    period: np.ndarray | None = None

    def __post_init__(self):
        for name in self._told:
            dtype = np.int64 if name in ("episode", "entry") else np.float32
            array = np.ascontiguousarray(getattr(self, name), dtype=dtype)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        counts = {len(getattr(self, name)) for name in self._told}
        if len(counts) != 1 or self.states.shape != self.next_states.shape:
            raise LogError(
                f"transitions with states {self.states.shape}, actions {self.actions.shape}, context "
                f"{self.context.shape}, next states {self.next_states.shape}, episode {self.episode.shape}",
                expected="the same N in all, and as many next states as states",
                do="build them with `transitions`",
            )

    @property
    def _told(self) -> list[str]:
        return [field.name for field in fields(self) if getattr(self, field.name) is not None]

    def __len__(self) -> int:
        return len(self.states)

    def take(self, rows: slice | np.ndarray) -> "Transitions":
        """These rows (a slice or numbers)."""
        return Transitions(**{name: getattr(self, name)[rows] for name in self._told})


def filled(recording: Recording, inputs: Mapping[str, float], settings: Mapping[str, float]) -> Recording:
    """A recording with these values of inputs (channels) where it has none, or NaN, and of settings that it lacks."""
    missing = [name for name in inputs if name not in recording.names]
    channels = recording.channels + tuple(Channel(name, "1") for name in missing)
    names = [channel.name for channel in channels]
    episodes = []
    for e in recording.episodes:
        values = np.pad(e.values, ((0, 0), (0, len(missing))), constant_values=np.nan)
        for name, value in inputs.items():
            column = values[:, names.index(name)]
            column[np.isnan(column)] = value
        episodes.append(Episode(e.name, e.time, values, dict(settings) | dict(e.settings)))
    return Recording(channels, tuple(episodes), recording.measured, recording.provenance)


def joined(parts: Sequence[Transitions]) -> Transitions:
    """The rows of all parts, one after the other; of one part itself."""
    if len(parts) == 1:
        return parts[0]
    names = set.intersection(*(set(part._told) for part in parts))
    return Transitions(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def transitions(
    recording: Recording, states: Sequence[str], actions: Sequence[str], context: Sequence[str] = ()
) -> Transitions:
    """The transitions of all episodes; none spans two episodes.

    Names in `context` are channels (inputs) or settings (constants of an episode), in the order given. Rows
    in which anything is NaN are left out. Raises LogError for a name that the recording does not have.
    """
    state_columns, action_columns = recording.columns(states), recording.columns(actions)
    parts = []
    for number, episode in enumerate(recording.episodes):
        now = episode.values[:-1, state_columns]
        after = episode.values[1:, state_columns]
        act = episode.values[:-1, action_columns]
        extra = np.empty((len(now), len(context)))
        for column, name in enumerate(context):
            if name in episode.settings:
                extra[:, column] = episode.settings[name]
            elif name in recording.names:
                extra[:, column] = episode.values[:-1, recording.names.index(name)]
            else:
                raise LogError(
                    f"episode {episode.name!r} has neither an input nor a setting {name!r}",
                    expected=one_of([*recording.names, *episode.settings], name),
                    do="add it to the map",
                )
        good = np.isfinite(np.concatenate([now, after, act, extra], axis=1)).all(axis=1)
        parts.append((now[good], act[good], extra[good], after[good], np.full(good.sum(), number)))
    return Transitions(*(np.concatenate(column) for column in zip(*parts, strict=True)))
