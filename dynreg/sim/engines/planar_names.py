"""Where each channel and action of a wheeled robot lives in a planar base."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.names import joint_of, parts_of
from dynreg.errors import RobotError
from dynreg.sim.ports import nominal_ports
from dynreg.sim.robot import Robot

QUANTITIES = ("speed", "yaw_rate", "x", "y", "yaw")
ON_WHEELS = ("left/position", "right/position", "left/velocity", "right/velocity")
COMMANDS = ("speed_command", "yaw_rate_command")
WHEEL_COMMANDS = ("left/velocity_command", "right/velocity_command")


@dataclass(frozen=True)
class Base:
    """Columns of a planar base.

    channels : (S,) which of QUANTITIES and ON_WHEELS each is. commands : (A,) which of both velocities, or on
    `wheels` which wheel (0 left, 1 right) each action commands. ranges : (A, 2) of the actions.
    """

    channels: np.ndarray
    commands: np.ndarray
    ranges: np.ndarray
    wheels: bool


def planar_base(robot: Robot) -> Base:
    """Resolve the robot's names: "<base>/speed", yaw_rate, x, y, yaw, and the commands of the base or its wheels.

    Raises RobotError where a name is none of a base, there are several, or a drive is told no velocity.
    """
    table = robot.file.base
    sides = {} if table is None else {table.left: "left", table.right: "right"}
    owners = {owner for name in (*robot.channels, *robot.actions) if (owner := joint_of(name)) not in sides}
    if len(owners) != 1 and not (sides and not owners):
        raise RobotError(
            f"the names of {robot.name!r} have the prefixes {sorted(owners)}",
            expected="one base, as in 'base/speed' and 'base/speed_command'",
            do="correct the names, or choose another engine",
        )
    types = nominal_ports(robot, 1).types
    wrong = [a for a, t in zip(robot.actions, types, strict=True) if t != "velocity"]
    if wrong:
        raise RobotError(
            f"the drive of action {wrong[0]!r} is not one of a planar base",
            expected='type = "velocity"',
            do="correct the drive, or choose another engine",
        )
    possible = (*QUANTITIES, *ON_WHEELS) if sides else QUANTITIES
    commands = WHEEL_COMMANDS if sides else COMMANDS
    return Base(
        np.array([_index("channel", name, possible, sides) for name in robot.channels], dtype=int),
        np.array([_index("action", name, commands, sides) for name in robot.actions], dtype=int),
        robot.action_ranges,
        bool(sides),
    )


def _index(what: str, name: str, choices: Sequence[str], sides: dict[str, str]) -> int:
    """Which of `choices` a name is; sides : {wheel: "left" or "right"}."""
    owner, quantity = parts_of(name)
    known = f"{sides[owner]}/{quantity}" if owner in sides else quantity
    if known not in choices:
        wheels = {side: wheel for wheel, side in sides.items()}
        named = [f"{wheels[of]}/{then}" if then else of for of, then in map(parts_of, choices)]
        raise RobotError(
            f"{what} {name!r} is not of a planar base", expected=f"one of {named}", do="correct it"
        )
    return choices.index(known)
