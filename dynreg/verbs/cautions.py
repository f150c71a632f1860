"""What the operator of an experiment minds before playing it: what no limit bounds, and how its episodes end."""

from collections.abc import Iterator

import numpy as np

from dynreg.data.names import joint_of, quantity_of
from dynreg.excite.limits import Limits, crowded, joint_range
from dynreg.excite.playing import closed
from dynreg.sim.excitation import command_range, reset_pose, targets
from dynreg.sim.ports import nominal_ports
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

FLOOR = ("x", "y")  # quantities of a base that tell where it is on the floor


def beginning(robot: Robot) -> str:
    """Where each episode begins, and where targets end."""
    return f"at rest in the reset pose{', to which its targets return' if targets(robot).any() else ''}"


def ending(robot: Robot) -> str:
    """How the last row of each episode leaves the robot."""
    held = targets(robot)
    rest = (("holds its targets", held), ("sets all torques, voltages and speeds to 0", ~held))
    return f"the last row of each {' and '.join(what for what, some in rest if some.any())}"


def largest_steps(robot: Robot, run: Run) -> np.ndarray:
    """(A,) largest change from command to command, from the reset pose through all episodes as they are played."""
    played = np.concatenate([reset_pose(robot)[None], *closed(robot, run.actions)])
    return np.abs(np.diff(played, axis=0)).max(axis=0)


def cautions(robot: Robot, limits: Limits, run: Run, reached: np.ndarray) -> Iterator[str]:
    """Sentences about what no limit bounds: collisions, commands, their steps, drives that let go, how far all goes.

    reached : (E, 2, S) lowest and highest states to expect.
    """
    if not robot.planar:
        yield _unchecked(robot)
    tables, moved = robot.file.actions, (run.actions != reset_pose(robot)).any(axis=(0, 1))
    unbounded = moved & ~(np.isfinite(limits.low) & np.isfinite(limits.high))
    if unbounded.any():
        ends = [(run.actions[..., a].min(), run.actions[..., a].max()) for a in range(len(tables))]
        told = [f"{tables[a].name} ({_span(*ends[a], tables[a].unit)})" for a in np.flatnonzero(unbounded)]
        yield f"no limits are known of {', '.join(told)}: give low and high in [[actions]] of robot.toml"
    yield from _fast(robot, moved & targets(robot) & np.isinf(limits.rate), largest_steps(robot, run))
    middle = command_range(robot, reset_pose(robot)).mean(axis=1)
    for a in np.flatnonzero(moved & crowded(robot)):
        where = f"{middle[a]:.3g} {tables[a].unit}, the middle of its range"
        yield f"the patterns of {tables[a].name} go about {where}, because it rests near an end"
    yield from _dropped(robot, run)
    yield from _travel(robot, reached)


def _unchecked(robot: Robot) -> str:
    """That links may hit each other: few models have contacts between links, and `robots init` turns them off."""
    slowly = "play the commands slowly first, with" if targets(robot).all() else "keep"
    return f"collisions of links with each other and their surroundings are not checked: {slowly} a hand at the stop"


def _dropped(robot: Robot, run: Run) -> Iterator[str]:
    """Which drives are switched off in which episodes."""
    enables = nominal_ports(robot, 1).enable_input
    off = None if run.inputs is None else (run.inputs == 0.0).any(axis=1)  # (E, I)
    for enable in np.unique(enables[enables >= 0]) if off is not None else ():
        if off[:, enable].any():
            joints = dict.fromkeys(robot.joints[a] for a in np.flatnonzero(enables == enable))
            episodes = ", ".join(map(str, np.flatnonzero(off[:, enable])))
            yield (
                f"the drives of {', '.join(joints)} are switched off halfway through {episodes}: keep clear of what"
                " swings and falls then"
            )


def _fast(robot: Robot, free: np.ndarray, steps: np.ndarray) -> Iterator[str]:
    """The largest step of targets (A,) whose speed nothing limits, those of one unit together."""
    for unit in dict.fromkeys(table.unit for table in robot.file.actions):
        some = [a for a in np.flatnonzero(free) if robot.file.actions[a].unit == unit]
        if some:
            names = ", ".join(dict.fromkeys(robot.joints[a] for a in some))
            yield (
                f"no speed limit of {names} is known: the largest step is {steps[some].max():.3g} {unit} in one"
                " command; give speed_limit in robot.toml"
            )


def _travel(robot: Robot, reached: np.ndarray) -> Iterator[str]:
    """How far joints without stops and bases on wheels are expected to go."""
    told = {
        name: _span(reached[:, 0, column].min(), reached[:, 1, column].max(), table.unit)
        for column, (name, table) in enumerate(zip(robot.channels, robot.file.channels, strict=True))
    }
    if robot.planar:
        floor = [f"{name} {span}" for name, span in told.items() if quantity_of(name) in FLOOR]
        goes = f"expected are {', '.join(floor)}" if floor else "no channel tells where the base goes"
        yield f"keep the floor free: {goes}"
        return
    free = [name for name in told if _is_free(robot, name)]
    if free:
        where = ", ".join(f"{joint_of(name)} (expected {told[name]})" for name in free)
        yield (
            f"no stops are known of {where}: if there are any, give the joint a range in the model, or its"
            " position channel low and high in robot.toml"
        )


def _is_free(robot: Robot, channel: str) -> bool:
    """Whether a channel is the position of a driven joint that nothing stops."""
    driven = joint_of(channel) in robot.driven and quantity_of(channel) == "position"
    return driven and not np.isfinite(joint_range(robot, channel)).all()


def _span(low: float, high: float, unit: str) -> str:
    return f"from {low:.3g} to {high:.3g} {unit}"
