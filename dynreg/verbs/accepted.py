"""Robots that a registry takes: those of which `dynreg robots check` tells no error."""

from dynreg.errors import RobotError, taken_apart
from dynreg.limits import limits
from dynreg.registry import Registry
from dynreg.registry.cache import ROBOT_CHECK
from dynreg.sim.inspection import inspect_files
from dynreg.sim.robot import Robot, is_packaged
from dynreg.sim.versions import versions

_SOUND: set[str] = set()  # hashes of those that were checked in this process


def accept(registry: Registry, robot: Robot) -> None:
    """Raise RobotError with the first error of a robot's folder.

    What a check tells is kept by the robot's hash, the limits and the versions; a check that came to no end (NotTried)
    is not. The robots that come with dynreg are checked by its tests.
    """
    if robot.hash in _SOUND or is_packaged(robot):
        return
    key = {"robot": robot.hash, "limits": vars(limits()), "versions": versions()}
    known = registry.cached(ROBOT_CHECK, key)
    if known is None:
        errors = [str(finding) for finding in inspect_files(robot.files) if finding.severity == "error"]
        known = {"errors": errors}
        registry.cache(ROBOT_CHECK, key, known)
    if known["errors"]:
        problem, expected, do = taken_apart(known["errors"][0])
        more = len(known["errors"]) - 1
        raise RobotError(
            f"robot {robot.name!r} cannot be used: {problem}" + (f" (and {more} more)" if more else ""),
            expected=expected or "a robot folder in which `dynreg robots check` finds no error",
            do=f"{do or 'mend it'}; `dynreg robots check {robot.folder}` shows all of them",
        )
    _SOUND.add(robot.hash)
