"""The robots that come along, a copy of one to change, and the check of a robot folder."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from dynreg.errors import DynregError, MapError, RobotError, UsageError
from dynreg.folder import TOML, Folder
from dynreg.results.robots import RobotCheck, RobotLine, RobotList
from dynreg.sim.finding import Finding, in_one_order
from dynreg.sim.inspection import inspect_robot
from dynreg.sim.robot import Robot, load_robot, packaged_robots
from dynreg.tomlfile import Location, line_of, literal, toml_text
from dynreg.verbs.written import new_folder


def robot_list() -> RobotList:
    """The packaged robots."""
    return RobotList(robots=tuple(_line(name) for name in packaged_robots()))


def robot_check(folder: str) -> RobotCheck:
    """The errors and warnings of a robot folder or a packaged robot.

    Where nothing else is wrong with it, its gait, motions and tasks are made as a search would make them, and its maps
    are held against its channels.
    """
    found = inspect_robot(folder)
    if not any(one.severity == "error" for one in found):
        robot = load_robot(folder)
        found = in_one_order([*found, *_gait_findings(robot), *_map_findings(robot)])
    told = {kind: tuple(str(one) for one in found if one.severity == kind) for kind in ("error", "warning")}
    return RobotCheck(robot=folder, sound=not told["error"], problems=told["error"], warnings=told["warning"])


def robot_copy(source: str, folder: Path) -> RobotCheck:
    """Copy a packaged robot, or a robot folder, to a new folder whose name the robot gets; the check of the copy.

    Raises RobotError where `source` is no robot, UsageError where the folder's name is taken or none for a robot, or
    the folder cannot be written. Nothing is left then.
    """
    robot, name = load_robot(source), folder.absolute().name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_\-]{0,99}", name) or name in packaged_robots():
        raise UsageError(
            f"robot name {name!r}, by the folder's",
            expected="a letter, then letters, digits, - and _; no name of a robot that comes with dynreg",
            do="give the folder another name",
        )
    files = robot.files.files
    lines = toml_text(files[TOML], TOML, RobotError).splitlines(keepends=True)
    at = line_of("".join(lines), ("robot", "name")) - 1
    lines[at] = lines[at].replace(literal(robot.name), literal(name), 1)
    with new_folder(folder) as hidden:
        Folder({**files, TOML: "".join(lines).encode()}).write(hidden)
        if load_robot(hidden).name != name:
            raise RobotError(
                f"the name of robot {robot.name!r} cannot be replaced in its {TOML}",
                expected=f"the line `name = {literal(robot.name)}` under [robot]",
                do="write it so",
            )
    return robot_check(str(folder))


def _gait_findings(robot: Robot) -> Iterator[Finding]:
    """What keeps `dynreg gait` from a gait, a motion or a task of robot.toml."""
    file = robot.file
    if file.gait is None and not file.motions and not file.tasks:
        return
    from dynreg.gait.space import gait_space
    from dynreg.gait.tasks import task_of

    made: list[tuple[Location, Callable]] = [(("gait",), partial(gait_space, robot))] if file.gait else []
    made += [(("motions", i), partial(gait_space, robot, one.name)) for i, one in enumerate(file.motions)]
    made += [(("tasks", i), partial(task_of, robot, one.name)) for i, one in enumerate(file.tasks)]
    text = toml_text(robot.files.files[TOML], TOML, RobotError)
    for location, make in made:
        try:
            make()
        except DynregError as problem:
            yield Finding("error", str(problem), line_of(text, location))


def _map_findings(robot: Robot) -> Iterator[Finding]:
    """What keeps `dynreg ingest` from reading a log with one of the robot's own maps."""
    from dynreg.data.maps import check_map, read_own_map

    for path in sorted((robot.folder / "maps").glob("*.toml")):
        try:
            check_map(read_own_map(path), robot.recording_spec)
        except MapError as problem:
            yield Finding("warning", f"maps/{path.name}: {problem}")


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
