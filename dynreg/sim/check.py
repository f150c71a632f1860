"""What is wrong with a robot folder beyond loading it: every name resolved, every extreme simulated."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from dynreg.errors import DynregError
from dynreg.folder import Folder
from dynreg.sim.child import in_child
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import TYPICAL, bank_period, excitation, reset_pose
from dynreg.sim.mjcf import model_files, trust_model, try_model
from dynreg.sim.robot import Robot, is_packaged, load_robot, packaged_robots, robot_of
from dynreg.sim.run import Run, motor_noise
from dynreg.sim.space import Parameter, ParameterSpace
from dynreg.sim.spec import SettingTable
from dynreg.sim.unitcheck import unit_problems

BUDGET = 300_000  # physics steps for one engine
EPISODES = 8
SAME = 1e-9  # of a channel's largest value: below it two rollouts are the same
HALVED = 0.25  # share of the motion that half the time step may change within SHORT
SHORT = 0.1  # [s]
STAND = 1.0  # [s]


def check_robot(ref: str | Path) -> list[str]:
    """What is wrong with a robot folder, one line each; empty when it can be simulated.

    Goes further than `load_robot`: compiles the model, resolves every name against it and simulates the
    nominal and the extreme configurations for some steps; those of a foreign robot in a process with limits.
    """
    try:
        robot = load_robot(ref)
        return problems(robot) if is_packaged(robot) else _problems_in_child(robot)
    except DynregError as problem:
        return [str(problem)]


def check_files(files: Mapping[str, bytes]) -> list[str]:
    """What is wrong with a robot folder that holds these files, as `check_robot` says it, in this process."""
    try:
        robot = robot_of(Folder(files), Path())
        trust_model(model_files(robot.files), robot.file.robot.model)
        return problems(robot)
    except DynregError as problem:
        return [str(problem)]


def _problems_in_child(robot: Robot) -> list[str]:
    try_model(model_files(robot.files), robot.file.robot.model, packaged_robots().values())
    return in_child(check_files, robot.files.files, limit="check_seconds")


def problems(robot: Robot) -> list[str]:
    """What is wrong with a robot, one line each with what to do; empty when it can be simulated.

    Names, units and timing are all looked at, then, where every name resolves, the nominal configuration and
    the low and high end of each parameter run through the robot's own excitation on each of its engines.
    """
    try:
        robot.model  # noqa: B018 (compiles it)
    except DynregError as problem:
        return [str(problem)]
    engines = list(robot.engines)
    names = _once(_names(robot), engines)
    found = [*names, *_declared(robot), *unit_problems(robot)]
    if names:
        return found
    return found + _once(((e, line) for e in engines for line in _simulated(robot, e)), engines)


def _once(found: Iterable[tuple[str | None, str]], engines: Sequence[str]) -> list[str]:
    """(engine, line) pairs as lines, each told once, with the engines that say it where not all of them do."""
    by_line: dict[str, list[str | None]] = {}
    for engine, line in found:
        by_line.setdefault(line, []).append(engine)
    return [
        line
        if None in who or set(who) == set(engines)
        else f"{' and '.join(dict.fromkeys(who))} engine: {line}"
        for line, who in by_line.items()
    ]


def _names(robot: Robot) -> Iterator[tuple[str | None, str]]:
    """(engine, line) of channels, actions, keyframe (no engine) and `sets` entries that lead nowhere."""
    try:
        robot.keyframe  # noqa: B018 (looks it up)
    except DynregError as problem:
        yield None, str(problem)
        robot = _with(robot, reset=robot.file.reset.model_copy(update={"keyframe": None}))
    for engine in robot.engines:
        good: dict[str, list] = {"channels": [], "actions": []}
        for group in ("actions", "channels"):
            for table in getattr(robot.file, group):
                alone = _with(robot, [], settings=[], **(good | {"channels": [], group: [table]}))
                problem = _problem(alone, engine)
                if problem is None:
                    good[group].append(table)
                else:
                    yield engine, str(problem)
        whole = _with(robot, [], settings=[], **good)
        for parameter in robot.space.parameters:
            for entry in _entries(parameter, good, robot):
                problem = _problem(_with(whole, [replace(parameter, sets=(entry,))]), engine)
                if problem is not None:
                    yield engine, f"parameter {parameter.name!r}: {problem}"
        for setting in robot.file.settings:
            for entry in _entries(setting, good, robot):
                alone = _with(whole, settings=[setting.model_copy(update={"sets": [entry]})])
                problem = _problem(alone, engine)
                if problem is not None:
                    yield engine, f"setting {setting.name!r}: {problem}"
        if len(good["channels"]) == len(robot.channels) and len(good["actions"]) == len(robot.actions):
            problem = _problem(whole, engine)
            if problem is not None:
                yield engine, str(problem)


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


def _declared(robot: Robot) -> Iterator[str]:
    """Tables of robot.toml that nothing uses, and a time step that is longer than a command."""
    owners = [*zip(robot.joints, robot.actions, strict=True)]
    for i, drive in enumerate(robot.file.drives):
        if not any(fnmatchcase(name, drive.joint) for pair in owners for name in pair):
            yield f"drive {i + 1} (joint {drive.joint!r}) moves no action; correct or remove it"
    if "drop" in robot.file.excitation.kinds and not any(drive.enable for drive in robot.file.drives):
        yield "excitation kind 'drop' switches drives off, but no drive has `enable`; add it or remove 'drop'"
    if robot.file.fall is not None and not any(robot.model.jnt_type == 0):
        yield "[fall] needs a free joint and the model has none; remove [fall] or add a <freejoint>"
    for setting in robot.file.settings:
        if not setting.values:
            yield f"setting {setting.name!r} has no `values`: populations would not cover it; list them"

    table = robot.file.robot
    if table.control_rate is not None and table.timestep * table.control_rate > 1 + 1e-9:
        yield (
            f"[robot] timestep {table.timestep:g} s is longer than the {1 / table.control_rate:g} s between "
            "commands; lower it to at most that"
        )


def _simulated(robot: Robot, engine: str) -> list[str]:
    """Rollouts of the nominal values, of both ends of each parameter and of each setting."""
    # the robot's own excitation, cut to the budget
    table, bank = robot.file.robot, robot.file.excitation
    episodes = min(bank.episodes, max(EPISODES, len(bank.kinds)))
    substeps = max(1.0, 1.0 / (table.timestep * (table.control_rate or TYPICAL)))
    rows = (2 * len(robot.space) + 1) * episodes * substeps
    steps = min(bank.steps, max(10, int(BUDGET / rows)))
    run = excitation(robot, seed=0, name="check", episodes=episodes, steps=steps)
    labels, values = ["the nominal robot"], [robot.space.nominal]
    for i, p in enumerate(robot.space.parameters):
        for end in (p.low, p.high):
            labels.append(f"parameter {p.name!r} at {end:g} {p.unit}")
            values.append(np.where(np.arange(len(robot.space)) == i, end, robot.space.nominal))
    try:
        ends = rollout(robot, np.array(values), _noisy(run, len(values)), engine=engine)
    except DynregError as problem:
        return [str(problem)]
    found = list(_diverging(robot, labels, ends.states))
    if not found:
        found += _idle(robot, ends.states)
        found += _idle_settings(robot, run, engine)
        found += _coarse(robot, run, engine, ends.states[:1])
    return [*found, *_standing(robot, engine)]


def _noisy(run: Run, simulators: int) -> Run:
    """The same motor noise for every simulator, so that they differ in their parameters alone."""
    steps, actions = run.actions.shape[-2:]
    noise = motor_noise(np.zeros(1, dtype=int), run.episodes, steps, actions)
    return replace(run, noise=np.repeat(noise, simulators, axis=0))


def _diverging(robot: Robot, labels: list[str], states: np.ndarray) -> Iterator[str]:
    for label, rows in zip(labels, states, strict=True):
        lost = ~np.isfinite(rows).all(axis=(0, 2))
        if lost.any():
            yield (
                f"{label} diverges at step {int(lost.argmax())}; lower [robot] timestep "
                f"(now {robot.file.robot.timestep:g} s), or correct masses, inertias, gains or the range"
            )


def _idle(robot: Robot, states: np.ndarray) -> Iterator[str]:
    for i, parameter in enumerate(robot.space.parameters):
        if _same(states[1 + 2 * i], states[2 + 2 * i]):
            yield (
                f"parameter {parameter.name!r} changes nothing between {parameter.low:g} and "
                f"{parameter.high:g} {parameter.unit}; correct its `sets`, or raise [excitation] amplitude"
            )


def _idle_settings(robot: Robot, run: Run, engine: str) -> Iterator[str]:
    for k, setting in enumerate(robot.file.settings):
        ends = [min(setting.values, default=setting.nominal), max(setting.values, default=setting.nominal)]
        if ends[0] == ends[1]:
            continue
        states = []
        for end in ends:
            settings = np.where(np.arange(len(robot.settings)) == k, end, run.settings)
            changed = _noisy(replace(run, settings=settings), 1)
            states.append(rollout(robot, robot.space.nominal[None], changed, engine=engine).states)
        if not all(np.isfinite(s).all() for s in states):
            yield f"setting {setting.name!r} diverges within {ends}; correct its values or `sets`"
        elif _same(*states):
            yield f"setting {setting.name!r} changes nothing within {ends}; correct its `sets`"


def _standing(robot: Robot, engine: str) -> Iterator[str]:
    if robot.file.fall is None:
        return
    steps = round(STAND * (robot.file.robot.control_rate or TYPICAL))
    hold = Run(np.tile(reset_pose(robot), (1, steps, 1)), period=bank_period(robot))
    if rollout(robot, robot.space.nominal[None], hold, engine=engine).fell[0, 0] <= steps:
        yield (
            f"the nominal robot falls within {STAND:g} s of holding its reset pose; correct the keyframe, "
            "the drives or [fall]"
        )


def _coarse(robot: Robot, run: Run, engine: str, coarse: np.ndarray) -> Iterator[str]:
    """Whether half the time step gives another motion from the start (later, contacts and chaos part it)."""
    table = robot.file.robot
    fine = _with(robot, robot=table.model_copy(update={"timestep": table.timestep / 2}))
    states = rollout(fine, robot.space.nominal[None], _noisy(run, 1), engine=engine).states
    steps = max(3, round(SHORT * (table.control_rate or TYPICAL)))
    rates = np.array([c.unit.endswith("/s") for c in robot.file.channels])
    columns = np.flatnonzero(~rates) if not rates.all() else np.arange(len(rates))  # impacts shift rates
    before, after = (x[:, :, : steps + 1, columns] for x in (coarse, states))
    motion = np.sqrt(((before - before[:, :, :1]) ** 2).mean(axis=(0, 1, 2)))
    change = np.sqrt(((after - before) ** 2).mean(axis=(0, 1, 2)))
    worst = int(np.argmax(change - HALVED * motion))
    share = 100 * change[worst] / max(motion[worst], 1e-12)
    if change[worst] > HALVED * motion[worst] + 1e-4 * np.abs(before).max():
        yield (
            f"[robot] timestep {table.timestep:g} s is too long: half of it changes "
            f"{robot.channels[columns[worst]]!r} by {share:.0f} % of its motion; lower it"
        )


def _same(first: np.ndarray, second: np.ndarray) -> bool:
    scale = np.maximum(np.abs(first), np.abs(second)).max(axis=tuple(range(first.ndim - 1)))
    return bool((np.abs(first - second) <= SAME * scale).all())


def _with(robot: Robot, parameters: list[Parameter] | None = None, /, **parts) -> Robot:
    """The robot with other parameters and other parts of its file, and the same compiled model."""
    space = robot.space if parameters is None else ParameterSpace(tuple(parameters))
    changed = replace(robot, space=space, file=robot.file.model_copy(update=parts))
    changed.__dict__["model"] = robot.model
    return changed
