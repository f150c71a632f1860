"""Bodies beside the robot, such as a ball: each has a free joint of its own, and `tracked` of robot.toml names some."""

from collections.abc import Iterator

import numpy as np

from dynreg.errors import RobotError, quoted
from dynreg.sim.base import FREE
from dynreg.sim.robot import Robot


def bodies_beside(robot: Robot) -> dict[str, int]:
    """{name: number} of the bodies with a free joint that is not the robot's base."""
    model = robot.model
    free = np.setdiff1d(np.flatnonzero(model.jnt_type == FREE), [robot.base])
    return {model.body(int(body)).name: int(body) for body in model.jnt_bodyid[free]}


def tracked_bodies(robot: Robot) -> np.ndarray:
    """(n,) numbers of the bodies that robot.toml tracks; RobotError where one is not beside the robot."""
    for problem in tracked_problems(robot):
        raise problem
    bodies = bodies_beside(robot)
    return np.array([bodies[name] for name in robot.file.robot.tracked], dtype=int)


def tracked_problems(robot: Robot) -> Iterator[RobotError]:
    """One error for each name in `tracked` that no body beside the robot has."""
    beside = [*bodies_beside(robot)] if robot.file.robot.tracked else []
    for name in robot.file.robot.tracked:
        if name not in beside:
            yield RobotError(
                f"tracked body {name!r} is not beside the robot in the model",
                expected=f"one of {quoted(beside)}: bodies with a free joint of their own",
                do="correct `tracked` of [robot], or add a <freejoint> to the body in the MJCF",
            )


def own_geoms(robot: Robot, geoms: np.ndarray) -> np.ndarray:
    """Those of these geoms (their numbers) that are not on a tracked body, nor on what it carries."""
    model, tracked = robot.model, tracked_bodies(robot)
    return geoms[~np.isin(model.body_rootid[model.geom_bodyid[geoms]], model.body_rootid[tracked])]
