"""Numbers that a user states of joints: one of all, or one of each by its name or a glob."""

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase

from dynreg.errors import UsageError

Stated = float | Mapping[str, float]  # of all joints, or {name or glob: number}, of which later ones win
EVERY = "*"


def stated_of(text: str, setting: str) -> Stated:
    """What a text states: "1500", "joint1=1500,joint5=500", "1500,wrist*=300".

    Raises UsageError, in which the setting is called `setting`, for a text that states no numbers above 0.

    >>> stated_of("1500", "kp"), stated_of("1500,wrist*=300", "kp")
    (1500.0, {'*': 1500.0, 'wrist*': 300.0})
    >>> stated_of("wrist*=300,1500,wrist*=200", "kp")
    {'*': 1500.0, 'wrist*': 200.0}
    """
    found: dict[str, float] = {}
    for part in text.split(","):
        name, equals, number = part.rpartition("=")
        key = name.strip() if equals else EVERY
        found.pop(key, None)  # a key that is given again comes last
        found[key] = _number(number, text, setting)
    return found[EVERY] if found.keys() == {EVERY} else found


def _number(text: str, whole: str, setting: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise UsageError(
            f"{setting} {whole!r}",
            expected="a number above 0, for all joints or as JOINT=NUMBER,...",
            do="give it as 1500, or as joint1=1500,joint5=500",
            setting=setting,
        )
    return value


def of_joint(stated: Stated | None, joint: str) -> float | None:
    """What is stated of a joint; None where nothing is."""
    if not isinstance(stated, Mapping):
        return stated
    return next((value for name, value in reversed(stated.items()) if fnmatchcase(joint, name)), None)


def unknown(stated: Stated | None, joints: Iterable[str]) -> list[str]:
    """The names and globs that fit none of the joints."""
    named = stated if isinstance(stated, Mapping) else {}
    return [name for name in named if not any(fnmatchcase(joint, name) for joint in joints)]


def stated_words(stated: Stated) -> str:
    """As it is typed.

    >>> stated_words(5.0), stated_words({"*": 1500.0, "wrist*": 300.0})
    ('5', '*=1500,wrist*=300')
    """
    if not isinstance(stated, Mapping):
        return f"{stated:g}"
    return ",".join(f"{name}={value:g}" for name, value in stated.items())
