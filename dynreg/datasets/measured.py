"""A recording as a part of a dataset: its episodes in the columns of its robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording, is_even
from dynreg.data.table import read_parquet
from dynreg.data.trajectories import Columns, Trajectories
from dynreg.data.transitions import filled


@dataclass(frozen=True, eq=False)
class RecordingPart:
    """A stored recording, read when it is asked for.

    path : of its Parquet file. identity : its id. robot : hash of the robot that tells columns, inputs and settings.
    inputs, settings : values where the log has none, by name.
    """

    path: Path
    identity: str
    robot: str
    columns: Columns
    inputs: Mapping[str, float]
    settings: Mapping[str, float]

    @property
    def entries(self) -> tuple[str, ...]:
        """Its id alone."""
        return (self.identity,)

    @cached_property
    def _sizes(self) -> tuple[int, int, np.ndarray, tuple[str, ...]]:
        parts = self.read()
        periods = [np.median(np.diff(p.time)) if p.time.shape[2] > 1 else np.nan for p in parts]
        return (
            sum(p.states.shape[2] for p in parts),
            sum(len(p.transitions()) for p in parts),
            np.array(periods),
            tuple(p.episodes[0] for p in parts if not is_even(p.time[0, 0])),
        )

    @property
    def rows(self) -> int:
        """How many states."""
        return self._sizes[0]

    @property
    def count(self) -> int:
        """How many transitions in which everything was measured."""
        return self._sizes[1]

    @property
    def periods(self) -> np.ndarray:
        """(E,) seconds from a row to the next, the median of each episode; NaN of a single row."""
        return self._sizes[2]

    @property
    def uneven(self) -> tuple[str, ...]:
        """Names of the episodes whose rows follow each other after different times; see `recording.is_even`."""
        return self._sizes[3]

    def read(self) -> tuple[Trajectories, ...]:
        """An episode in each; LogError where the file is damaged."""
        recording = filled(read_parquet(self.path), self.inputs, self.settings)
        return tuple(self._episode(recording, episode) for episode in recording.episodes)

    def _episode(self, recording: Recording, episode: Episode) -> Trajectories:
        columns, held = self.columns, {name: i for i, name in enumerate(recording.names)}

        def told(channels: Sequence[Channel]) -> np.ndarray:
            out = np.full((len(episode.time), len(channels)), np.nan, np.float32)
            for i, channel in enumerate(channels):
                if channel.name in held:
                    out[:, i] = episode.values[:, held[channel.name]]
            return out

        return Trajectories(
            columns=columns,
            entries=(self.identity,),
            numbers=None,
            episodes=(episode.name,),
            time=episode.time[None, None],
            states=told(columns.states)[None, None],
            actions=told(columns.actions)[None],
            inputs=told(columns.inputs)[None],
            settings=np.array([[episode.settings[c.name] for c in columns.settings]], np.float32),
        )
