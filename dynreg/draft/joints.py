"""Joints of a robot in groups that a lab would give one number: each alone, by their type, or all together."""

import re
from collections.abc import Sequence

from dynreg.data.words import words

_SIDES = frozenset(
    "l r left right f b front back rear fl fr rl rr bl br hl hr lf rf lh rh lb rb lr hind fore mid".split()
)
_WORDS = frozenset(("joint", "jnt", "leg", "motor", "actuator", "robot"))


def kind_of(name: str) -> str:
    """What is left of a joint's name without its side, its leg and the words said of any joint.

    >>> kind_of("FL_hip_joint"), kind_of("joint3"), kind_of("left_knee"), kind_of("fr_hx_leg_joint")
    ('hip', '3', 'knee', 'hx')
    """
    left = [word for word in words(name) if word not in _SIDES and word not in _WORDS]
    return "_".join(left) or name


def by_kind(names: Sequence[str]) -> dict[str, list[str]]:
    """{type: joints of it} in the order of the names."""
    out: dict[str, list[str]] = {}
    for name in names:
        out.setdefault(kind_of(name), []).append(name)
    return out


def groups(names: Sequence[str], most: int) -> dict[str, list[str]]:
    """{group: joints} of at most `most` groups: each joint alone, else by type, else all as one, called "".

    >>> groups(["a", "b"], 2), groups(["l_hip", "r_hip", "l_knee", "r_knee"], 2)["hip"]
    ({'a': ['a'], 'b': ['b']}, ['l_hip', 'r_hip'])
    >>> groups(["a", "b", "c"], 2)
    {'': ['a', 'b', 'c']}
    """
    if len(names) <= most:
        return {name: [name] for name in names}
    kinds = by_kind(names)
    return kinds if len(kinds) <= most and len(kinds) < len(names) else {"": list(names)}


def identifier(text: str) -> str:
    """A text as the name of a parameter: letters, digits and underscores.

    >>> identifier("robot0:WRJ1"), identifier("3rd")
    ('robot0_WRJ1', 'j3rd')
    """
    plain = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_") or "joint"
    return plain if plain[0].isalpha() else f"j{plain}"
