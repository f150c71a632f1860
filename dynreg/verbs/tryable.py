"""What a calibration may try gaits on, and the robot or recording that it is asked about."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynreg.adapt.tried import Rules
from dynreg.errors import NoMatchError, RobotError, UsageError
from dynreg.methods.scored import Played
from dynreg.registry import Registry
from dynreg.sim.real import RealRobot
from dynreg.sim.robot import Robot, packaged_robots
from dynreg.verbs.subjects import loaded_robot


@dataclass(frozen=True)
class Tryable:
    """The robot itself, gaits to begin with, and sizes other than the published ones.

    real : see `ScoredRobot`. gait : a stored gait, {gene: value}, or None for those of the robot's folder.
    """

    real: RealRobot | Played
    gait: str | Path | Mapping[str, float] | None = None
    rules: Rules | None = None


def robot_to_try(registry: Registry, subject: Any, method: str) -> Robot:
    """The robot that a method tries; UsageError where a recording or a log is given instead."""
    try:
        if isinstance(subject, str | Path | Robot):
            return loaded_robot(subject, registry=registry)
    except RobotError:
        if not (_is_recording(registry, subject) or Path(subject).is_file()):
            raise
    raise UsageError(
        f"method {method!r} tries a robot, and reads no recording such as {str(subject)!r}",
        expected="a robot: a packaged name or a folder",
        do="name the robot, or choose another method for the recording",
    )


def require_recording(registry: Registry | None, subject: Any, method: str) -> None:
    """UsageError where a robot is given to a method that reads a recording; registry : None where there is none yet."""
    own = isinstance(subject, str | Path) and (
        str(subject) in packaged_robots() or (Path(subject) / "robot.toml").is_file()
    )
    if isinstance(subject, Robot) or (own and (registry is None or not _is_recording(registry, subject))):
        name = subject.name if isinstance(subject, Robot) else str(subject)
        raise UsageError(
            f"method {method!r} needs a recording, and {name!r} is a robot",
            expected="a registered recording, or a log with --robot",
            do="name one, or try gaits on the robot with --method btr",
        )


def _is_recording(registry: Registry, ref: Any) -> bool:
    try:
        return registry.resolve(str(ref), ("recording",))[0] == "recording"
    except NoMatchError:
        return False


def real_of(
    real: Any, registry: Registry, robot: Robot, log_map: Any, say: Callable[[str], None], method: str
) -> RealRobot | Played:
    """The robot as it is tried: itself, a function, or a folder for its trials. Raises UsageError for anything else."""
    from dynreg.data.maps import read_map
    from dynreg.verbs.trial_folder import TrialFolder, folder_of

    if isinstance(real, str | Path):
        given = None if log_map is None else read_map(log_map)
        return TrialFolder(folder_of(real), registry, robot, given, say)
    if isinstance(real, RealRobot) or callable(real):
        return real
    raise UsageError(
        f"method {method!r} without a robot to try"
        if real is None
        else f"a robot of type {type(real).__name__!r}",
        expected="a folder for its trials; in Python also a RealRobot, or a function that plays commands",
        do="name a folder with --trial, or give `robot_door` in Python",
    )
