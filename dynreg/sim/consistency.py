"""What the parts of a robot.toml say about each other: names used twice, names that lead nowhere."""

from collections.abc import Iterator

from dynreg.data.names import joint_of
from dynreg.errors import RobotError, one_of, quoted
from dynreg.sim.sets import parse
from dynreg.sim.spec import RobotFile
from dynreg.tomlfile import Location, line_of

Problem = tuple[Location, str, str, str]  # where it stands, what is wrong, what is expected, what to do


def check_consistency(file: RobotFile, text: str, name: str) -> None:
    """Raise RobotError, with the line of `text`, for the first name or `sets` entry of `file` that cannot be."""
    for location, problem, expected, do in inconsistencies(file):
        raise RobotError(f"{name}, line {line_of(text, location)}: {problem}", expected=expected, do=do)


def inconsistencies(file: RobotFile) -> Iterator[Problem]:
    """All names and `sets` entries of a file that cannot be."""
    for groups in (("actions", "channels", "inputs"), ("settings",), ("parameters",)):
        yield from _twice(file, groups)
    yield from _drives(file)
    for group in ("parameters", "settings"):
        for i, table in enumerate(getattr(file, group)):
            for entry in table.sets:
                try:
                    parse(entry)
                except RobotError as error:
                    yield (group, i, "sets"), error.problem, error.expected, error.do
    yield from _populations(file)
    yield from _twice(file, ("materials",))
    actions = [table.name for table in file.actions]
    for side in ("left", "right") if file.base else ():
        name = f"{getattr(file.base, side)}/velocity_command"
        if name not in actions:
            problem = f"no action {name!r} drives the {side} wheel"
            yield (
                ("base", side),
                problem,
                f"the wheel of one of {actions}",
                "add the action, or correct the wheel",
            )
    yield from _gait(file)


def _gait(file: RobotFile) -> Iterator[Problem]:
    driven = [joint_of(action.name) for action in file.actions]
    for i, leg in enumerate(file.gait.legs if file.gait else ()):
        for joint in leg.joints.values():
            if joint not in driven:
                problem = f"leg {leg.name!r}: no action drives joint {joint!r}"
                yield (
                    ("gait", "legs", i, "joints"),
                    problem,
                    f"joints out of {quoted(driven)}",
                    "correct [[gait.legs]]",
                )
    motions = [motion.name for motion in file.motions]
    for i, task in enumerate(file.tasks):
        if task.motion is None and file.gait is None:
            yield ("tasks", i, "name"), "there are tasks, but no [gait]", "the legs and roles", "add [gait]"
        elif task.motion is not None and task.motion not in motions:
            problem = f"task {task.name!r}: there is no motion {task.motion!r}"
            yield ("tasks", i, "motion"), problem, f"one of {motions}", "add it to [[motions]], or correct it"
    yield from _twice(file, ("motions",))
    yield from _twice(file, ("tasks",))


def _populations(file: RobotFile) -> Iterator[Problem]:
    scales = {p.name: p.scale for p in file.parameters}
    for label, population in file.populations.items():
        for name, (low, _) in population.ranges.items():
            location = ("populations", label, "ranges", name)
            if name not in scales:
                yield (
                    location,
                    f"unknown parameter {name!r}",
                    one_of(scales, name, "robot.toml has no parameters"),
                    "correct its spelling",
                )
            elif scales[name] == "log" and low <= 0:
                problem = f"{name}: low {low:g} on a log scale"
                yield location, problem, "low > 0", "raise it, or use scale linear"


def _twice(file: RobotFile, groups: tuple[str, ...]) -> Iterator[Problem]:
    seen: set[str] = set()
    for group, number, name in ((g, i, t.name) for g in groups for i, t in enumerate(getattr(file, g))):
        if name in seen:
            yield (group, number, "name"), f"{name!r} is named twice", "unique names", "rename one of them"
        seen.add(name)


def _drives(file: RobotFile) -> Iterator[Problem]:
    inputs = [i.name for i in file.inputs]
    others = {t.name for t in (*file.actions, *file.channels, *file.inputs)}
    for i, drive in enumerate(file.drives):
        supply = getattr(drive, "supply_input", None)
        if supply is not None and supply not in inputs:
            problem = f"supply_input {supply!r} is no input"
            yield ("drives", i, "supply_input"), problem, f"one of {inputs}", "add it to [[inputs]]"
        if drive.enable in others:
            problem = f"enable {drive.enable!r} is already an action, a channel or an input"
            expected, do = (
                "a name of its own, such as 'arm/enabled'",
                "rename it; an enable channel needs no table",
            )
            yield ("drives", i, "enable"), problem, expected, do
