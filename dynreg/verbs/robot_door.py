"""The robot that gaits are tried on: which one is asked about, and the door through which it is played."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynreg.errors import NoMatchError, RobotError, UsageError
from dynreg.gait.tasks import Task
from dynreg.methods.scored import Player
from dynreg.registry import Registry
from dynreg.sim.real import RealRobot
from dynreg.sim.robot import Robot, packaged_robots
from dynreg.verbs.calibrate import TRIALS, able, no_door
from dynreg.verbs.subjects import loaded_robot

if TYPE_CHECKING:
    from dynreg.adapt.tried import Rules
    from dynreg.verbs.calibrate import CalibrateSettings


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
            do=f"name one, or try gaits on the robot with --method {' or '.join(able('trials'))}",
        )


def _is_recording(registry: Registry, ref: Any) -> bool:
    try:
        return registry.resolve(str(ref), ("recording",))[0] == "recording"
    except NoMatchError:
        return False


def door_of(
    door: Any,
    registry: Registry,
    robot: Robot,
    task: Task,
    settings: "CalibrateSettings",
    log_map: Any,
    say: Callable[[str], None],
    rules: "Rules",
) -> RealRobot | Player:
    """The robot as it is tried: itself, a function, or a folder for its trials, which says of which rules they are.

    Raises UsageError for anything else, for a map where no log is read from a file, and as `ScoredFolder.begin`.
    """
    from dynreg.data.maps import read_map
    from dynreg.verbs.scored_folder import ScoredFolder
    from dynreg.verbs.trial_folder import folder_of

    method = settings.method
    if isinstance(door, str | Path):
        given, path = None if log_map is None else read_map(log_map), folder_of(door)
        told = {"method": method, "seed": settings.seed, "goal": rules.goal, "search": rules.search}
        most = settings.trials or TRIALS
        folder = ScoredFolder(path, registry, robot, given, say, task=task, most=most, **told)
        folder.begin(settings.resume)
        return folder
    if not isinstance(door, RealRobot) and not callable(door):
        raise no_door(f"a robot of type {type(door).__name__!r}")
    if log_map is not None:
        raise UsageError(
            f"log_map {str(log_map)!r} with a robot that Python plays",
            expected="a map only with a folder of trials, whose logs it reads",
            do="leave it out, and have the function read the log with it",
            setting="log_map",
        )
    return door


def place_of(door: Any) -> str:
    """Which robot is tried, as far as can be told: its folder, or what plays its trials in Python."""
    if isinstance(door, str | Path):
        return str(Path(door).resolve())
    what = door if hasattr(door, "__qualname__") else type(door)
    return f"python {what.__module__}.{what.__qualname__}"
