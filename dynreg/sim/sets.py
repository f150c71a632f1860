"""The `sets` grammar of robot.toml: "TARGET OP" says what a value does to a simulator.

TARGET is `mj.<MjModel field>[<elements>][<index>]`, `port.<port>.<key>[<joints or actions>]`,
`control.<key>` or `modifier.<name>[<bodies or sites>]`; elements are names or globs, separated by commas, and without
them all are meant; OP is `=`, `+=` or `*=`.
"""

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from dynreg.errors import RobotError, one_of

_FORM = re.compile(
    r"^(?P<root>mj|port|control|modifier)\.(?P<path>[A-Za-z_][A-Za-z0-9_.]*)"
    r"(\[(?P<first>[^\]]+)\])?(\[(?P<second>\d+)\])?\s*(?P<op>=|\+=|\*=)$"
)
NAMES = {
    "control": ("rate", "noise", "max_step", "clock"),
    "modifier": ("link_length", "mass", "added_mass", "gravity"),
}
NO_LIMIT = 1e6  # of a drive: each limit that robot.toml does not state
DRIVE_DEFAULTS = {  # of drives whose type does not have the key
    "gain": 1.0,
    "integral_gain": 0.0,
    "rate_gain": 0.0,
    "torque_limit": NO_LIMIT,
    "speed_limit": NO_LIMIT,
    "back_emf": 0.0,
    "duty_limit": 1.0,
    "profile_speed": NO_LIMIT,
    "profile_acceleration": NO_LIMIT,
    "duty_gain": 0.0,
    "kt": 0.0,
    "resistance": 1.0,
    "supply": 0.0,
    "lag": 0.0,
    "gain_factor": 1.0,
    "limit_factor": 1.0,
}
PORT_KEYS = {
    "drive": tuple(DRIVE_DEFAULTS),
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
FRICTION_FIELDS = {  # of the model, beside the port of that name: what is set there is the joint's whole friction
    "coulomb": "dof_frictionloss",
    "viscous": "dof_damping",
}


def is_limit(limit: np.ndarray | float) -> np.ndarray | bool:
    """Whether a drive states a limit, elementwise: no `NO_LIMIT`, nor a share of it."""
    return limit < 0.1 * NO_LIMIT


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
    if assignment.root in NAMES:
        _check_choice(text, assignment.path, NAMES[assignment.root])
    elif assignment.root == "port":
        port, _, key = assignment.path.partition(".")
        _check_choice(text, port, tuple(PORT_KEYS))
        _check_choice(text, key, PORT_KEYS[port])
    _check_brackets(assignment)
    return assignment


def _check_brackets(assignment: Assignment) -> None:
    """RobotError for an index or elements that would do nothing."""
    whole = f"{assignment.root}.{assignment.path}"
    single = assignment.root == "control" or whole.startswith("port.base.") or whole == "modifier.gravity"
    if single and assignment.elements:
        raise RobotError(
            f"sets entry {assignment.text!r}: {whole} is one number of the whole robot",
            expected=f"'{whole} {assignment.op}'",
            do="leave the brackets out",
        )
    if assignment.index is not None and (assignment.root != "mj" or assignment.path.startswith("opt.")):
        raise RobotError(
            f"sets entry {assignment.text!r}: what it names has no index [{assignment.index}]",
            expected="an index behind the elements of a field of the model, such as 'mj.geom_friction[foot][0] ='",
            do="leave the index out",
        )


def _check_choice(text: str, given: str, choices: tuple[str, ...]) -> None:
    if given not in choices:
        raise RobotError(
            f"sets entry {text!r} names {given!r}",
            expected=one_of(choices, given),
            do="correct the entry",
        )


def matching(names: list[str], patterns: tuple[str, ...], text: str) -> np.ndarray:
    """Indexes of `names` that match any of the globs `patterns`; RobotError when a pattern matches none.

    A bare "*", or no pattern, is all of them, those without a name ("") too; no other glob matches these.
    """
    found: set[int] = set()
    for pattern in patterns or ("*",):
        hits = [i for i, name in enumerate(names) if pattern == "*" or (name and fnmatchcase(name, pattern))]
        if not hits:
            raise RobotError(
                f"sets entry {text!r}: nothing is named {pattern!r}",
                expected=one_of([n for n in names if n], "", "the model names none"),
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
