"""What is wrong with a robot folder, all of it at once: read, every name resolved, every extreme simulated."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.errors import DynregError, RobotError
from dynreg.folder import TOML, Folder
from dynreg.sim.beside import tracked_problems
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import bank_period
from dynreg.sim.extremes import try_out
from dynreg.sim.finding import Finding, Said, in_one_order
from dynreg.sim.lint import doubts
from dynreg.sim.materials import material_problems
from dynreg.sim.mjcf import model_files, trust_model
from dynreg.sim.reading import read_all
from dynreg.sim.robot import Robot, robot_from
from dynreg.sim.run import Run
from dynreg.sim.space import Parameter, ParameterSpace
from dynreg.sim.spec import SettingTable
from dynreg.sim.unitcheck import unit_problems
from dynreg.tomlfile import toml_text

Told = tuple[Said, str]  # what is said, and its severity


def check_files(files: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """`findings` of a folder that was tried before, as plain data."""
    folder = Folder(files)
    model = read_all(toml_text(folder.hashed.get(TOML, b""), TOML, RobotError)).file
    if model is not None:
        trust_model(model_files(folder), model.robot.model)
    return [vars(finding) for finding in findings(folder)]


def findings(files: Folder) -> list[Finding]:
    """What is wrong with a robot whose folder holds these files, in this process."""
    reading = read_all(toml_text(files.hashed.get(TOML, b""), TOML, RobotError))
    found = reading.errors()
    if reading.file is None:
        return in_one_order(found)
    try:
        robot = robot_from(reading.file, files, Path())
        robot.model  # noqa: B018 (compiles it)
    except DynregError as problem:
        return in_one_order([*found, Finding("error", str(problem), reading.line(("robot", "model")))])
    told = _told(robot, whole=not reading.said)
    found += [Finding(severity, message, reading.line(at)) for (at, message), severity in told]
    return in_one_order(found)


def problems(robot: Robot) -> list[str]:
    """The errors of a robot that could be loaded, one line each with what to do; empty when it can be used."""
    try:
        robot.model  # noqa: B018 (compiles it)
    except DynregError as problem:
        return [str(problem)]
    return [message for (_, message), severity in _told(robot, whole=True) if severity == "error"]


def _told(robot: Robot, whole: bool) -> Iterator[Told]:
    """What is wrong with a robot whose model compiles: names, units, timing, and then rollouts on each engine."""
    engines = list(robot.engines)
    names, sound = _names(robot)
    found = [*_once(names, engines), *_declared(robot), *unit_problems(robot)]
    yield from ((said, "error") for said in found)
    if len(sound.actions) < len(robot.actions) or not sound.channels or not len(sound.space):
        return
    yield from ((said, "warning") for said in doubts(sound))
    tried = {engine: try_out(sound, engine, whole=whole and not names) for engine in engines}
    for severity in ("errors", "warnings"):
        said = [(engine, one) for engine, of in tried.items() for one in getattr(of, severity)]
        yield from ((one, severity.removesuffix("s")) for one in _once(said, engines))


def _once(found: Iterable[tuple[str | None, Said]], engines: Sequence[str]) -> list[Said]:
    """(engine, what it says) each told once, with the engines that say it where not all of them do."""
    by_said: dict[Said, list[str | None]] = {}
    for engine, said in found:
        by_said.setdefault(said, []).append(engine)
    return [
        (at, line if None in who or set(who) == set(engines) else f"{_and(who)} engine: {line}")
        for (at, line), who in by_said.items()
    ]


def _and(engines: Iterable[str | None]) -> str:
    return " and ".join(dict.fromkeys(str(engine) for engine in engines))


def _names(robot: Robot) -> tuple[list[tuple[str | None, Said]], Robot]:
    """(engine, what it says) of channels, actions, keyframe (no engine) and `sets` that lead nowhere; the rest."""
    found: list[tuple[str | None, Said]] = []
    try:
        robot.keyframe  # noqa: B018 (looks it up)
    except DynregError as problem:
        found.append((None, (("reset", "keyframe"), str(problem))))
        robot = _with(robot, reset=robot.file.reset.model_copy(update={"keyframe": None}))
    if [*tracked_problems(robot)]:  # which `_declared` tells
        robot = _with(robot, robot=robot.file.robot.model_copy(update={"tracked": []}))
    lost: set[tuple[str, str]] = set()
    for engine in robot.engines:
        for said in _names_on(robot, engine):
            found.append((engine, said))
            lost.add((str(said[0][0]), str(said[0][1]) if len(said[0]) > 1 else ""))
    if not lost:
        return found, robot
    kept = {
        group: [table for table in getattr(robot.file, group) if (group, table.name) not in lost]
        for group in ("channels", "actions", "settings")
    }
    parameters = [p for p in robot.space.parameters if ("parameters", p.name) not in lost]
    if any(group == "robot" for group, _ in lost):  # the whole of it cannot be simulated
        kept["actions"], kept["channels"] = [], []
    return found, _with(robot, parameters, **kept)


def _names_on(robot: Robot, engine: str) -> Iterator[Said]:
    good: dict[str, list] = {"channels": [], "actions": []}
    if _problem(robot, engine) is None:  # every name at once; one by one only where one of them is wrong
        return
    for group in ("actions", "channels"):
        for table in getattr(robot.file, group):
            # beside those that are sound: two of them may be at odds with each other
            tried = good | {"channels": [], group: [*good[group], table]}
            problem = _problem(_with(robot, [], settings=[], **tried), engine)
            if problem is None:
                good[group].append(table)
            else:
                yield (group, table.name, "name"), str(problem)
    whole = _with(robot, [], settings=[], **good)
    for parameter in robot.space.parameters:
        for entry in _entries(parameter, good, robot):
            problem = _problem(_with(whole, [replace(parameter, sets=(entry,))]), engine)
            if problem is not None:
                yield ("parameters", parameter.name, "sets"), f"parameter {parameter.name!r}: {problem}"
    for setting in robot.file.settings:
        for entry in _entries(setting, good, robot):
            alone = _with(whole, settings=[setting.model_copy(update={"sets": [entry]})])
            problem = _problem(alone, engine)
            if problem is not None:
                yield ("settings", setting.name, "sets"), f"setting {setting.name!r}: {problem}"
    if len(good["channels"]) == len(robot.channels) and len(good["actions"]) == len(robot.actions):
        problem = _problem(whole, engine)
        if problem is not None:
            yield ("robot", "engines"), str(problem)


def _entries(table: Parameter | SettingTable, good: dict[str, list], robot: Robot) -> list[str]:
    """The `sets` that can be tried: ports need all actions, and those that fail were told."""
    whole = len(good["actions"]) == len(robot.actions)
    return [entry for entry in table.sets if whole or not entry.startswith("port.")]


def _problem(robot: Robot, engine: str) -> DynregError | None:
    """What one step on an engine raises."""
    reset = robot.file.reset.model_copy(update={"settle": 0.0})
    try:
        rollout(
            _with(robot, reset=reset),
            robot.space.nominal[None],
            Run(np.zeros((1, 1, len(robot.actions))), period=bank_period(robot)),
            engine=engine,
            threads=1,
        )
    except DynregError as problem:
        return problem
    return None


def _declared(robot: Robot) -> Iterator[Said]:
    """Tables of robot.toml that nothing uses, and a time step that is longer than a command."""
    owners = [*zip(robot.joints, robot.actions, strict=True)]
    for i, drive in enumerate(robot.file.drives):
        if not any(fnmatchcase(name, drive.joint) for pair in owners for name in pair):
            told = f"drive {i + 1} (joint {drive.joint!r}) moves no action; correct or remove it"
            yield ("drives", i, "joint"), told
    if "drop" in robot.file.excitation.kinds and not any(drive.enable for drive in robot.file.drives):
        told = (
            "excitation kind 'drop' switches drives off, but no drive has `enable`; add it or remove 'drop'"
        )
        yield ("excitation", "kinds"), told
    if robot.file.fall is not None and not robot.floating:
        yield (
            ("fall",),
            "[fall] needs a base with a free joint and the robot has none; remove [fall] or add a <freejoint>",
        )
    for problem in tracked_problems(robot):
        yield ("robot", "tracked"), str(problem)
    geoms = [robot.model.geom(i).name for i in range(robot.model.ngeom)]
    for location, problem, expected, do in material_problems(robot.file, geoms):
        yield location, str(RobotError(problem, expected=expected, do=do))
    for setting in robot.file.settings:
        if not setting.values:
            told = f"setting {setting.name!r} has no `values`: populations would not cover it; list them"
            yield ("settings", setting.name, "name"), told

    table = robot.file.robot
    if table.control_rate is not None and table.timestep * table.control_rate > 1 + 1e-9:
        yield (
            ("robot", "timestep"),
            f"[robot] timestep {table.timestep:g} s is longer than the {1 / table.control_rate:g} s between "
            "commands; lower it to at most that",
        )


def _with(robot: Robot, parameters: list[Parameter] | None = None, /, **parts) -> Robot:
    """The robot with other parameters and other parts of its file, and the same compiled model."""
    space = robot.space if parameters is None else ParameterSpace(tuple(parameters))
    changed = replace(robot, space=space, file=robot.file.model_copy(update=parts))
    changed.__dict__["model"] = robot.model
    return changed
