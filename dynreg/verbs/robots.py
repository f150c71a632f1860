"""The robots that come along, and the check of a robot folder."""

from dynreg.results.robots import RobotCheck, RobotLine, RobotList
from dynreg.sim.inspection import inspect_robot
from dynreg.sim.robot import load_robot, packaged_robots


def robot_list() -> RobotList:
    """The packaged robots."""
    return RobotList(robots=tuple(_line(name) for name in packaged_robots()))


def robot_check(folder: str) -> RobotCheck:
    """The errors and warnings of a robot folder or a packaged robot."""
    found = inspect_robot(folder)
    told = {kind: tuple(str(one) for one in found if one.severity == kind) for kind in ("error", "warning")}
    return RobotCheck(robot=folder, sound=not told["error"], problems=told["error"], warnings=told["warning"])


def _line(name: str) -> RobotLine:
    robot = load_robot(name)
    head = robot.file.robot
    return RobotLine(
        name=robot.name,
        title=head.title or "",
        engines=tuple(head.engines),
        control_rate=head.control_rate,
        channels=robot.channels,
        actions=robot.actions,
        settings=robot.settings,
        parameters=tuple(p.name for p in robot.space.parameters),
    )
