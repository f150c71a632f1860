"""Names of channels and commands, "<joint>/<quantity>" as in "arm/position", and of pieces of episodes."""

import re
from fnmatch import fnmatchcase


def parts_of(name: str) -> tuple[str, str]:
    """The joint, or base, and the quantity of a name; the quantity is "" where there is no "/"."""
    joint, _, quantity = name.partition("/")
    return joint, quantity


def joint_of(name: str) -> str:
    """The joint or body of a channel or a command: "arm" of "arm/position"."""
    return parts_of(name)[0]


def quantity_of(name: str) -> str:
    """What a channel measures or a command sets: "position" of "arm/position"."""
    return parts_of(name)[1]


def position_of(velocity: str) -> str | None:
    """The position of which a joint's velocity is the rate; None for what is named as no velocity.

    >>> position_of("arm/velocity"), position_of("arm/torque")
    ('arm/position', None)
    """
    joint, quantity = parts_of(velocity)
    return f"{joint}/position" if quantity == "velocity" else None


def fits(name: str, pattern: str) -> bool:
    """Whether a name is the pattern itself, brackets and all, or one that it matches.

    >>> fits("run[3]", "run[3]"), fits("run[3]", "run*")
    (True, True)
    """
    return name == pattern or fnmatchcase(name, pattern)


def piece_of(episode: str, number: int) -> str:
    """The name of a piece of an episode that was cut into several: "run[3]"."""
    return f"{episode}[{number}]"


def episode_of(piece: str) -> str:
    """The episode of a piece; the name itself of one that is whole.

    >>> episode_of(piece_of("run", 3)), episode_of("run")
    ('run', 'run')
    """
    return re.sub(r"\[\d+\]$", "", piece)
