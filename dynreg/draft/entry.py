"""What a draft is made of: the tables of robot.toml with a word on where their numbers come from, and options."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from dynreg.draft.stated import Stated
from dynreg.folder import Folder
from dynreg.sim.robot import Robot

DriveKind = Literal["position", "torque", "velocity"]


@dataclass(frozen=True)
class Entry:
    """One table of robot.toml. values : its keys in order. said : where its numbers come from."""

    values: Mapping[str, Any]
    said: str = ""


@dataclass(frozen=True)
class DraftOptions:
    """What a user states about a robot.

    drive : the kind of all drives, in place of that of the model's actuators. kp [N*m/rad or N/m], kd [N*m*s/rad or
    N*s/m] : gains of position drives; kd alone is that of velocity drives. torque_limit [N*m or N]. Each is of all
    drives, or of some by their joints.
    free_base : the first body of a URDF moves freely; None leaves that to what a log measures (`base.with_base`).
    visuals : geoms and meshes that touch nothing are kept.
    """

    drive: DriveKind | None = None
    kp: Stated | None = None
    kd: Stated | None = None
    torque_limit: Stated | None = None
    free_base: bool | None = None
    visuals: bool = False


@dataclass(frozen=True)
class Drafted:
    """A robot folder in memory, and what a user should know of it.

    files : by their path in the folder. joints : names of those that move. base : the free joint, if any. notes : what
    was guessed, left out or not understood, one line each. map : path of the drafted map in the folder; None without
    logs. missing : channels for which the logs hold nothing.
    """

    robot: Robot
    files: dict[str, bytes]
    joints: tuple[str, ...]
    base: str | None
    notes: tuple[str, ...]
    map: str | None = None
    missing: tuple[str, ...] = ()


def write_draft(made: Drafted, folder: Path) -> None:
    """Write the files of a draft into a folder, which is made."""
    Folder(made.files).write(folder)


@dataclass
class Notes:
    """Lines about what was guessed, left out or not understood, each once, in order."""

    lines: list[str] = field(default_factory=list)

    def add(self, line: str) -> None:
        if line not in self.lines:
            self.lines.append(line)


def listed(names: list[str], most: int = 6) -> str:
    """Names as text: the first few, and how many more there are.

    >>> listed(["a", "b", "c"], most=2)
    'a, b and 1 more'
    """
    some = ", ".join(names[:most])
    return some if len(names) <= most else f"{some} and {len(names) - most} more"


def ranged(
    name: str, sets: str, nominal: float, unit: str, low: float, high: float, tolerance: float, said: str
) -> Entry:
    """A parameter with its range: on a logarithmic scale where that does not hold 0."""
    return Entry(
        {
            "name": name,
            "unit": unit,
            "nominal": nominal,
            "low": low,
            "high": high,
            "scale": "log" if low > 0 else "linear",
            "tolerance": tolerance,
            "sets": [sets],
        },
        said,
    )


def rounded(value: float) -> float:
    """To two digits: what a draft says is no better known."""
    return float(f"{value:.2g}")
