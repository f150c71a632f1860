"""The channels and settings that a recording must hold, without the robot itself."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ChannelSpec:
    """A channel that a log is asked for.

    `kind` is "state", "action", "input" (a measured exogenous signal) or "enable" (1 where the drive is on).
    `low`, `high` bound what the channel can be, in its unit; None where nothing is known. `stops` are those of its
    joint, for a position: the log's zero may be elsewhere, so they tell of a wrong unit alone.
    `hold` tells how it is resampled: True keeps the last value (commands, flags), False interpolates.
    """

    name: str
    unit: str
    kind: str
    optional: bool = False
    low: float | None = None
    high: float | None = None
    stops: tuple[float, float] | None = None

    @property
    def hold(self) -> bool:
        return self.kind in ("action", "enable")


@dataclass(frozen=True)
class RecordingSpec:
    """The channels and settings of one robot's recordings and the rate [Hz] they are resampled to.

    `rate` is None for robots whose control is timed: every row of a log stays as it is. `usual` : settings that a log
    need not tell; they are nominal then.
    """

    robot: str
    channels: tuple[ChannelSpec, ...]
    settings: tuple[str, ...]
    rate: float | None
    usual: tuple[str, ...] = ()
