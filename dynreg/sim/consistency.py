"""What the parts of a robot.toml say about each other: names used twice, names that lead nowhere."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from dynreg.data.names import joint_of
from dynreg.errors import RobotError
from dynreg.sim.sets import parse
from dynreg.sim.spec import RobotFile
from dynreg.tomlfile import Location, line_of


def check_consistency(file: RobotFile, path: Path) -> None:
    """Raise RobotError, with the line, for the first name or `sets` entry of `file` that cannot be."""
    for location, problem in _problems(file):
        line = line_of(path.read_text(encoding="utf-8"), location)
        raise RobotError(
            f"{path.name}, line {line}: {problem.problem}", expected=problem.expected, do=problem.do
        )


def _problems(file: RobotFile) -> Iterator[tuple[Location, RobotError]]:
    signals = [
        (group, i, t.name) for group in ("actions", "channels", "inputs") for i, t in _tables(file, group)
    ]
    yield from _twice(signals)
    for group in ("settings", "parameters"):
        yield from _twice([(group, i, t.name) for i, t in _tables(file, group)])
    yield from _drives(file)
    for group in ("parameters", "settings"):
        for i, table in _tables(file, group):
            for entry in table.sets:
                try:
                    parse(entry)
                except RobotError as problem:
                    yield (group, i, "sets"), problem
    yield from _populations(file)
    yield from _wheels(file)
    yield from _gait(file)


def _wheels(file: RobotFile) -> Iterator[tuple[Location, RobotError]]:
    if file.base is None:
        return
    actions = [table.name for table in file.actions]
    for side in ("left", "right"):
        name = f"{getattr(file.base, side)}/velocity_command"
        if name not in actions:
            yield (
                ("base", side),
                RobotError(
                    f"no action {name!r} drives the {side} wheel",
                    expected=f"the wheel of one of {actions}",
                    do="add the action, or correct the wheel",
                ),
            )


def _gait(file: RobotFile) -> Iterator[tuple[Location, RobotError]]:
    driven = [joint_of(action.name) for action in file.actions]
    for i, leg in enumerate(file.gait.legs if file.gait else ()):
        for joint in leg.joints.values():
            if joint not in driven:
                problem = RobotError(
                    f"leg {leg.name!r}: no action drives joint {joint!r}",
                    expected=f"joints out of {driven}",
                    do="correct [[gait.legs]]",
                )
                yield ("gait", "legs", i, "joints"), problem
    if file.tasks and file.gait is None:
        problem = RobotError("there are tasks, but no [gait]", expected="the legs and roles", do="add [gait]")
        yield ("tasks", 0, "name"), problem
    yield from _twice([("tasks", i, t.name) for i, t in _tables(file, "tasks")])


def _populations(file: RobotFile) -> Iterator[tuple[Location, RobotError]]:
    scales = {p.name: p.scale for p in file.parameters}
    for label, population in file.populations.items():
        for name, (low, _) in population.ranges.items():
            location = ("populations", label, "ranges", name)
            if name not in scales:
                yield (
                    location,
                    RobotError(
                        f"unknown parameter {name!r}",
                        expected=f"one of {list(scales)}",
                        do="correct its spelling",
                    ),
                )
            elif scales[name] == "log" and low <= 0:
                yield (
                    location,
                    RobotError(
                        f"{name}: low {low:g} on a log scale",
                        expected="low > 0",
                        do="raise it, or use scale linear",
                    ),
                )


def _tables(file: RobotFile, group: str) -> Iterable:
    return enumerate(getattr(file, group))


def _twice(items: list[tuple[str, int, str]]) -> Iterator[tuple[Location, RobotError]]:
    seen: set[str] = set()
    for group, number, name in items:
        if name in seen:
            problem = RobotError(f"{name!r} is named twice", expected="unique names", do="rename one of them")
            yield (group, number, "name"), problem
        seen.add(name)


def _drives(file: RobotFile) -> Iterator[tuple[Location, RobotError]]:
    inputs = [i.name for i in file.inputs]
    others = {t.name for group in ("actions", "channels", "inputs") for _, t in _tables(file, group)}
    for i, drive in _tables(file, "drives"):
        supply = getattr(drive, "supply_input", None)
        if supply is not None and supply not in inputs:
            problem = RobotError(
                f"supply_input {supply!r} is no input", expected=f"one of {inputs}", do="add it to [[inputs]]"
            )
            yield ("drives", i, "supply_input"), problem
        if drive.enable in others:
            problem = RobotError(
                f"enable {drive.enable!r} is already an action, a channel or an input",
                expected="a name of its own, such as 'arm/enabled'",
                do="rename it; an enable channel needs no table",
            )
            yield ("drives", i, "enable"), problem
