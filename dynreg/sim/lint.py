"""What a robot folder may say and will be sorry for: each finding is a warning, with what to do."""

from collections.abc import Iterator
from fnmatch import fnmatchcase

import numpy as np

from dynreg.data.names import joint_of
from dynreg.sim.at_odds import at_odds
from dynreg.sim.effects.contact import has_ground, touching_geoms
from dynreg.sim.excitation import command_limits, outside_limits, reset_pose, targets
from dynreg.sim.finding import Said
from dynreg.sim.layout import layout_of
from dynreg.sim.robot import Robot, packaged_robots
from dynreg.sim.sets import FRICTION_FIELDS, Assignment
from dynreg.sim.space import Parameter

FAR = (
    60.0  # tolerances from the nominal value to an end of the range: that of a factor of 2 known to 1 % is 69
)
FACTOR = 100.0  # between the ends of a mass's range: from a robot without its hand to one with fifty
ROUNDED = 1.001  # times that: robot.toml holds few digits
PAST = 0.5  # share of an action's range beyond the joint's, above which one of the two is taken for a slip
Setter = tuple[str, str, Assignment]  # "parameters" or "settings", its name, what it sets


def doubts(robot: Robot) -> Iterator[Said]:
    """What will be in the way later, by robot.toml and the model alone; every name must resolve."""
    yield from _tolerances(robot)
    yield from _wide_masses(robot)
    yield from _noiseless(robot)
    yield from _overwritten(robot)
    yield from _name_taken(robot)
    if not robot.planar:
        yield from _twice(robot)
        yield from _past_stops(robot)
        yield from _pose_outside(robot)
        yield from _no_ground(robot)
        yield from at_odds(robot)


def _tolerances(robot: Robot) -> Iterator[Said]:
    for p in robot.space.parameters:
        away = 0.0 if p.known else _tolerances_away(p)
        if away > FAR:
            yield (
                ("parameters", p.name, "tolerance"),
                f"parameter {p.name!r}: its range ends {away:.0f} tolerances from nominal, so no log moves it there; "
                "raise `tolerance` (1 sigma, relative to nominal) to what the lab is sure of, or narrow the range",
            )


def _tolerances_away(p: Parameter) -> float:
    """Tolerances between the nominal value and the further end of the range."""
    if p.scale == "log":
        return max(np.log(p.high / p.nominal), np.log(p.nominal / p.low)) / p.tolerance
    one = p.tolerance * (abs(p.nominal) or p.high - p.low)
    return max(p.high - p.nominal, p.nominal - p.low) / one


def _wide_masses(robot: Robot) -> Iterator[Said]:
    """Factors on masses that span more than two decades, and masses that span as much and outweigh the whole robot."""
    for p, several in zip(robot.space.parameters, robot.setters, strict=True):
        ops = {a.op for a in several if _path(a)[0] == "mj.body_mass"}
        wide = 0 < FACTOR * ROUNDED * p.low < p.high
        if wide and ("*=" in ops or ("=" in ops and p.high > robot.model.body_mass.sum())):
            yield (
                ("parameters", p.name, "high"),
                f"parameter {p.name!r}: its range spans a factor of {p.high / p.low:.2g} in mass: most of a population "
                f"would be no such robot; narrow it to a factor of at most {FACTOR:g}",
            )


def _noiseless(robot: Robot) -> Iterator[Said]:
    for channel, noise in zip(robot.file.channels, robot.sensor_noise, strict=True):
        if noise == 0:
            yield (
                ("channels", channel.name, "name"),
                f"channel {channel.name!r} has neither `noise` nor `quantum`: its errors cannot be told from those of "
                "its sensor; state the noise (1 sigma) of a robot at rest, or the quantum",
            )


def _setters(robot: Robot) -> list[Setter]:
    """What is set, in the order in which it is."""
    pairs = [("parameters", p.name, s) for p, s in zip(robot.space.parameters, robot.setters, strict=True)]
    pairs += [
        ("settings", t.name, s) for t, s in zip(robot.file.settings, robot.setting_setters, strict=True)
    ]
    return [(group, name, assignment) for group, name, several in pairs for assignment in several]


def _overwritten(robot: Robot) -> Iterator[Said]:
    setters = _setters(robot)
    for i, (group, name, later) in enumerate(setters):
        for earlier_group, earlier_name, earlier in setters[:i]:
            if later.op == "=" and name != earlier_name and _meet(earlier, later):
                yield (
                    (group, name, "sets"),
                    f"{group[:-1]} {name!r} overwrites {earlier_group[:-1]} {earlier_name!r}: both set "
                    f"{_target(later)!r}; let one go, or change it with '+=' or '*='",
                )


def _target(assignment: Assignment) -> str:
    return assignment.text.removesuffix(assignment.op).strip()


def _path(assignment: Assignment) -> tuple[str, int | None]:
    path = f"{assignment.root}.{assignment.path}"
    return "mj.body_mass" if path == "modifier.mass" else path, assignment.index


def _meet(first: Assignment, second: Assignment) -> bool:
    """Whether two entries set the same field of the same element."""
    (path, index), (other, other_index) = _path(first), _path(second)
    if path != other or (None not in (index, other_index) and index != other_index):
        return False
    pairs = [(a, b) for a in first.elements or ("*",) for b in second.elements or ("*",)]
    return any(_alike(a, b) or _alike(b, a) for a, b in pairs)


def _alike(name: str, pattern: str) -> bool:
    whole = "/" in name and "/" in pattern  # an action; else the joint that it moves
    return fnmatchcase(name, pattern) if whole else fnmatchcase(joint_of(name), joint_of(pattern))


def _name_taken(robot: Robot) -> Iterator[Said]:
    folder = packaged_robots().get(robot.name)
    if folder is not None and (folder / "robot.toml").read_bytes() != robot.files.files["robot.toml"]:
        yield (
            ("robot", "name"),
            f"the name {robot.name!r} is that of a robot that comes with dynreg, which `dynreg populate {robot.name}` "
            "means; give this one a name of its own",
        )


def _twice(robot: Robot) -> Iterator[Said]:
    """Damping and dry friction that are set at a port and in the model as well: they add up, or one is lost.

    '+=' at a port says that they shall add up, as an exported effect does.
    """
    setters = _setters(robot)
    for group, name, assignment in setters:
        port, _, key = assignment.path.partition(".")
        if assignment.root != "port" or port != "friction" or assignment.op == "+=":
            continue
        field = FRICTION_FIELDS[key]
        patterns = assignment.elements or ("*",)
        joints = [j for j in robot.driven if any(_alike(j, pattern) for pattern in patterns)]
        set_too = [n for _, n, a in setters if a.path == field and any(_covers(a, j) for j in joints)]
        if set_too:
            yield (
                (group, name, "sets"),
                f"{group[:-1]} {name!r} and {set_too[0]!r} both set the {field.removeprefix('dof_')} of joint "
                f"{joints[0]!r}: they add up, or the later one replaces the other; keep one of them",
            )


def _covers(assignment: Assignment, joint: str) -> bool:
    return any(fnmatchcase(joint, pattern) for pattern in assignment.elements or ("*",))


def _past_stops(robot: Robot) -> Iterator[Said]:
    """Ranges of targets that lie beyond the joints' stops for the most part: a little beyond, servos press on them."""
    if not robot.actions:
        return
    model, layout = robot.model, layout_of(robot)
    joints = model.dof_jntid[layout.action_dof]
    for action, joint, held in zip(robot.file.actions, joints, targets(robot), strict=True):
        if not held or not model.jnt_limited[joint] or action.low is None or action.high is None:
            continue
        low, high = model.jnt_range[joint]
        past = max(low - action.low, 0.0) + max(action.high - high, 0.0)
        if past > PAST * (action.high - action.low):
            yield (
                ("actions", action.name, "name"),
                f"action {action.name!r} goes from {action.low:g} to {action.high:g} {action.unit}, its joint from "
                f"{low:g} to {high:g}: targets beyond press the joint on its stop in a replay, and populations and "
                "experiments give none; correct the action's range or the joint's (mind degrees and radians)",
            )


def _pose_outside(robot: Robot) -> Iterator[Said]:
    """Reset poses that no command can hold: an experiment from there would begin beyond a limit."""
    (low, high), pose = command_limits(robot).T, reset_pose(robot)
    for a in np.flatnonzero(outside_limits(robot)):
        table = robot.file.actions[a]
        yield (
            ("actions", table.name, "name"),
            f"action {table.name!r}: the reset pose, {pose[a]:g} {table.unit}, is outside its limits {low[a]:g} to "
            f"{high[a]:g} {table.unit}, so no experiment can begin there; name a keyframe inside them in [reset], or "
            "correct the range",
        )


def _no_ground(robot: Robot) -> Iterator[Said]:
    if has_ground(robot):
        return
    if robot.floating:
        yield (
            ("robot", "model"),
            "the robot's base is free and the model has no ground that it could touch: it falls for ever, and effects "
            "of contact are not offered; add a <geom type='plane'> to the world, or hold the base",
        )
    elif _can_touch(robot):
        yield (
            ("robot", "model"),
            "geoms of the model can touch each other, but none of the world can be touched: effects of contact are not "
            "offered; add a ground, or take contacts out (contype='0' conaffinity='0'), which is faster",
        )


def _can_touch(robot: Robot) -> bool:
    """Whether any two geoms of different bodies can touch."""
    model, geoms = robot.model, touching_geoms(robot)
    bodies = model.geom_bodyid[geoms]
    met = (model.geom_contype[geoms][:, None] & model.geom_conaffinity[geoms]) > 0
    return bool((met & (bodies[:, None] != bodies)).any())
