"""What a robot did, measured or simulated: named channels with SI units over time, in episodes."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynreg.errors import LogError


@dataclass(frozen=True)
class Channel:
    """One named signal and its SI unit ("rad", "m/s", "N*m", "V", "1" for a bare number)."""

    name: str
    unit: str


@dataclass(frozen=True)
class Episode:
    """One uninterrupted run.

    Attributes
    ----------
    name : unique inside the recording.
    time : (T,) seconds, strictly increasing.
    values : (T, C) one column for each channel of the recording; NaN where nothing was measured.
    settings : known constants of this run (controller gain, added mass), by name, in SI units.
    """

    name: str
    time: np.ndarray
    values: np.ndarray
    settings: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        time = np.ascontiguousarray(self.time, dtype=np.float64)
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        if time.ndim != 1 or values.ndim != 2 or len(time) != len(values) or len(time) == 0:
            raise LogError(
                f"episode {self.name!r} has time of shape {time.shape} and values of shape {values.shape}",
                expected="time (T,) and values (T, C) with the same T > 0",
                do="pass one row of values for each time stamp",
            )
        if not np.all(np.diff(time) > 0):
            at = int(np.argmax(~(np.diff(time) > 0))) + 1
            raise LogError(
                f"episode {self.name!r}: time does not increase at row {at} "
                f"({time[at]!r} s after {time[at - 1]!r} s)",
                expected="strictly increasing time stamps",
                do="mend the log's clock, or let `dynreg doctor` show where it runs back",
            )
        time.setflags(write=False)
        values.setflags(write=False)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "settings", {str(k): float(v) for k, v in sorted(self.settings.items())})

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time[-1] - self.time[0])


@dataclass(frozen=True)
class Recording:
    """Episodes over the same channels, with where they came from.

    `measured` tells a real robot's log from a simulated one. `provenance` is plain JSON data: source,
    map, resampling, findings. The id hashes channels and episodes, not the provenance, so that the same
    numbers are the same recording wherever they were read from.
    """

    channels: tuple[Channel, ...]
    episodes: tuple[Episode, ...]
    measured: bool = True
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self):
        object.__setattr__(self, "channels", tuple(self.channels))
        object.__setattr__(self, "episodes", tuple(self.episodes))
        names = [c.name for c in self.channels]
        if len(set(names)) != len(names):
            raise LogError(
                f"channel named twice in {names}", expected="unique channel names", do="rename one of them"
            )
        if not self.episodes:
            raise LogError(
                "the recording has no episodes", expected="at least one", do="check the map and the log"
            )
        episode_names = [e.name for e in self.episodes]
        if len(set(episode_names)) != len(episode_names):
            raise LogError(
                f"episode named twice in {episode_names}", expected="unique names", do="rename one of them"
            )
        for episode in self.episodes:
            if episode.values.shape[1] != len(names):
                raise LogError(
                    f"episode {episode.name!r} has {episode.values.shape[1]} columns",
                    expected=f"{len(names)} columns, one for each of {names}",
                    do="give every episode the recording's channels",
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in column order."""
        return tuple(c.name for c in self.channels)

    @property
    def id(self) -> str:
        """Content hash, 64 hexadecimal digits."""
        digest = hashlib.sha256(json.dumps([[c.name, c.unit] for c in self.channels]).encode())
        for episode in self.episodes:
            digest.update(json.dumps([episode.name, episode.settings], sort_keys=True).encode())
            digest.update(episode.time.tobytes())
            digest.update(episode.values.tobytes())
        return digest.hexdigest()

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Column numbers of the channels `names`; LogError when one is missing."""
        index = {name: i for i, name in enumerate(self.names)}
        missing = [name for name in names if name not in index]
        if missing:
            raise LogError(
                f"channel {missing[0]!r} is missing",
                expected=f"one of {list(self.names)}",
                do="add it to the map, or ingest a log that holds it",
            )
        return np.array([index[name] for name in names], dtype=int)

    def select(self, names: Sequence[str]) -> "Recording":
        """The same episodes with only these episodes' names, in this order."""
        by_name = {episode.name: episode for episode in self.episodes}
        return Recording(
            self.channels, tuple(by_name[name] for name in names), self.measured, self.provenance
        )

    def to_frame(self):
        """A pandas DataFrame: columns `episode`, `time`, then one for each channel."""
        import pandas as pd

        frames = []
        for episode in self.episodes:
            frame = pd.DataFrame(episode.values, columns=list(self.names))
            frame.insert(0, "time", episode.time)
            frame.insert(0, "episode", episode.name)
            frames.append(frame)
        return pd.concat(frames, ignore_index=True)
