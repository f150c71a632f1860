"""The `sets` grammar of robot.toml: "TARGET OP" says what a value does to a simulator.

TARGET is `mj.<MjModel field>[<elements>][<index>]`, `port.<port>.<key>[<joints or actions>]`,
`control.<key>` or `modifier.<name>[<bodies>]`; elements are names or globs, separated by commas; OP is `=`,
`+=` or `*=`.
"""

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from dynreg.errors import RobotError

_FORM = re.compile(
    r"^(?P<root>mj|port|control|modifier)\.(?P<path>[A-Za-z_][A-Za-z0-9_.]*)"
    r"(\[(?P<first>[^\]]+)\])?(\[(?P<second>\d+)\])?\s*(?P<op>=|\+=|\*=)$"
)
CONTROL_KEYS = ("rate", "noise", "max_step", "clock")
PORT_KEYS = {
    "drive": (
        "gain",
        "rate_gain",
        "torque_limit",
        "speed_limit",
        "duty_gain",
        "kt",
        "resistance",
        "supply",
        "lag",
        "gain_factor",
        "limit_factor",
    ),
    "friction": ("coulomb", "viscous"),
    "sensor": ("offset", "scale"),
    "base": (
        "wheel_radius",
        "track",
        "speed_lag",
        "yaw_lag",
        "centrifugal",
        "speed_drag",
        "coupling",
        "yaw_drag",
    ),
}
MODIFIERS = ("link_length", "mass", "gravity")


@dataclass(frozen=True)
class Assignment:
    """One parsed entry of `sets`: `root` mj, port, control or modifier; `op` "=", "+=" or "*="."""

    text: str
    root: str
    path: str
    elements: tuple[str, ...]
    index: int | None
    op: str


def parse(text: str) -> Assignment:
    """The assignment that `text` stands for; RobotError when it is none."""
    match = _FORM.match(text.strip())
    if match is None:
        raise RobotError(
            f"sets entry {text!r}",
            expected="TARGET OP, such as 'mj.body_mass[tip] =' or 'port.drive.gain[*] *='",
            do="correct the entry",
        )
    first, second = match["first"], match["second"]
    elements = tuple(part.strip() for part in first.split(",")) if first else ()
    index = int(second) if second is not None else None
    assignment = Assignment(text, match["root"], match["path"], elements, index, match["op"])
    _check_path(assignment)
    return assignment


def _check_path(a: Assignment) -> None:
    if a.root == "control":
        _check_choice(a, a.path, CONTROL_KEYS)
    elif a.root == "modifier":
        _check_choice(a, a.path, MODIFIERS)
    elif a.root == "port":
        port, _, key = a.path.partition(".")
        _check_choice(a, port, tuple(PORT_KEYS))
        _check_choice(a, key, PORT_KEYS[port])


def _check_choice(a: Assignment, given: str, choices: tuple[str, ...]) -> None:
    if given not in choices:
        raise RobotError(
            f"sets entry {a.text!r} names {given!r}",
            expected=f"one of {list(choices)}",
            do="correct the entry",
        )


def matching(names: list[str], patterns: tuple[str, ...], text: str) -> np.ndarray:
    """Indexes of `names` that match any of the globs `patterns`; RobotError when a pattern matches none."""
    found: set[int] = set()
    for pattern in patterns or ("*",):
        hits = [i for i, name in enumerate(names) if name and fnmatchcase(name, pattern)]
        if not hits:
            raise RobotError(
                f"sets entry {text!r}: nothing is named {pattern!r}",
                expected=f"one of {[n for n in names if n]}",
                do="correct the element",
            )
        found.update(hits)
    return np.array(sorted(found), dtype=int)


def combine(op: str, old: np.ndarray, value: np.ndarray) -> np.ndarray:
    """`old` after `op` with `value`, broadcast over everything but the first axis (simulations)."""
    shaped = value.reshape(value.shape + (1,) * (old.ndim - value.ndim))
    if op == "=":
        return np.broadcast_to(shaped, old.shape)
    return old + shaped if op == "+=" else old * shaped
