"""The robots that come along, and the check of a robot folder."""

from dynreg.results.robots import RobotCheck, RobotLine, RobotList
from dynreg.sim.check import check_robot
from dynreg.sim.robot import load_robot, packaged_robots


def robot_list() -> RobotList:
    """The packaged robots."""
    return RobotList(robots=tuple(_line(name) for name in packaged_robots()))


def robot_check(folder: str) -> RobotCheck:
    """What is wrong with a robot folder or a packaged robot."""
    problems = tuple(check_robot(folder))
    return RobotCheck(robot=folder, sound=not problems, problems=problems)


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
