"""What a robot did, measured or simulated: named channels with SI units over time, in episodes."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from dynreg.axes import chosen, curves, draw_each
from dynreg.data.clocks import ABSOLUTE, begins
from dynreg.errors import LogError, one_of
from dynreg.foreign import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_ROWS = 20  # most rows of the table in a notebook
SAME_RATE = 0.01  # how far rates may be apart: the clock of a log is not exact
FAR = 4e9  # [s] of a clock: the year 2096; stamps beyond it are in another unit


def is_even(time: np.ndarray) -> bool:
    """Whether all steps between times (T,) [s] are the same, within 1 %."""
    steps = np.diff(time)
    return not len(steps) or bool(steps.max() <= steps.min() * (1 + SAME_RATE))


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

    def __repr__(self) -> str:
        settings = "".join(f", {name}={value:g}" for name, value in self.settings.items())
        return f"<Episode {self.name!r}: {len(self.time)} rows, {self.duration:.1f} s{settings}>"

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
    def rate(self) -> float | None:
        """Rows a second, the median over all; None where every episode has a single one."""
        gaps = np.concatenate([np.diff(episode.time) for episode in self.episodes])
        return float(1.0 / np.median(gaps)) if len(gaps) else None

    @property
    def is_even(self) -> bool:
        """Whether each row of an episode follows the one before it after the same time, within 1 %."""
        return all(is_even(episode.time) for episode in self.episodes)

    @property
    def id(self) -> str:
        """Content hash, 64 hexadecimal digits."""
        digest = hashlib.sha256(json.dumps([[c.name, c.unit] for c in self.channels]).encode())
        for episode in self.episodes:
            digest.update(json.dumps([episode.name, episode.settings], sort_keys=True).encode())
            digest.update(episode.time.tobytes())
            digest.update(episode.values.tobytes())
        return digest.hexdigest()

    def begins(self, pause: float = 0.0) -> np.ndarray:
        """(E,) seconds from the first episode's begin to each one's; see `clocks.begins`, also for `pause`."""
        return begins(*(np.array([e.time[at] for e in self.episodes]) for at in (0, -1)), pause)

    @property
    def began(self) -> float | None:
        """Seconds since a common epoch at which its first episode began, by the log's own clock.

        None where that is no clock of the day (it begins at 0 or with the computer), or nothing tells it.
        """
        clocks = [*self.provenance.get("clocks", {}).values()]
        return min(clocks) if clocks and min(clocks) >= ABSOLUTE and max(clocks) < FAR else None

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Column numbers of the channels `names`; LogError when one is missing."""
        index = {name: i for i, name in enumerate(self.names)}
        missing = [name for name in names if name not in index]
        if missing:
            raise LogError(
                f"channel {missing[0]!r} is missing",
                expected=one_of(self.names, missing[0]),
                do="add it to the map, or ingest a log that holds it",
            )
        return np.array([index[name] for name in names], dtype=int)

    def select(self, names: Sequence[str]) -> "Recording":
        """The same episodes with only these episodes' names, in this order."""
        by_name = {episode.name: episode for episode in self.episodes}
        return Recording(
            self.channels, tuple(by_name[name] for name in names), self.measured, self.provenance
        )

    def plot(
        self,
        channels: "str | Sequence[str] | None" = None,
        episode: str | None = None,
        ax: "Axes | None" = None,
    ) -> "np.ndarray":
        """Channels of an episode over time [s], each on an axes of its own in a new figure; (n,) matplotlib axes.

        channels : names, by default all. episode : its name, by default the first. ax : for one channel, where to draw.
        Raises UsageError for a channel or an episode that there is not, and for many channels on one `ax`.
        """
        names = chosen(self.names, channels, "channel")
        one = chosen([e.name for e in self.episodes], episode, "episode")[0]
        shown = next(e for e in self.episodes if e.name == one)

        def draw(place: "Axes", name: str) -> None:
            column = self.names.index(name)
            curves(
                place, shown.time, {name: shown.values[:, column]}, f"{name} [{self.channels[column].unit}]"
            )

        places = draw_each(names, draw, ax, what="channels")
        places[0].set_title(f"episode {one}")
        return places

    def __repr__(self) -> str:
        rows = sum(len(e.time) for e in self.episodes)
        seconds = sum(e.duration for e in self.episodes)
        kind = "measured" if self.measured else "simulated"
        return (
            f"<Recording {self.id[:12]}: {len(self.episodes)} episodes, {len(self.channels)} channels, {rows} rows,"
            f" {seconds:.1f} s, {kind}>"
        )

    def _repr_html_(self) -> str:
        """The channels, and a table with a row for each episode."""
        import pandas as pd

        rows = [
            {"episode": e.name, "rows": len(e.time), "seconds": e.duration, **e.settings}
            for e in self.episodes
        ]
        named = ", ".join(f"{c.name} [{c.unit}]" for c in self.channels)
        shown = pd.DataFrame(rows).map(lambda v: visible(v) if isinstance(v, str) else v)
        table = shown.to_html(index=False, float_format="%.4g", na_rep="-", max_rows=MOST_ROWS)
        return f"<p>{escape(visible(repr(self)))}</p><p>channels: {escape(visible(named))}</p>{table}"

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
