"""The kinds of hidden robots, by the name of the robot folder that is to explain their logs."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from dynreg.errors import UsageError, one_of, quoted
from dynreg.rng import stream
from dynreg.truths.arms import CAUSES_OF_ARMS, Arm
from dynreg.truths.causes import CAUSES, cause, drawn
from dynreg.truths.servo import SERVO
from dynreg.truths.six_joint_arm import SIX_JOINT_ARM
from dynreg.truths.truth import Commands, Truth, read
from dynreg.truths.two_joint_arm import TWO_JOINT_ARM
from dynreg.truths.wheels import CAUSES_OF_WHEELS, WHEELS, Wheels

KINDS: Mapping[str, Arm | Wheels] = MappingProxyType(
    {
        "servo_pendulum": SERVO,
        "two_joint_arm": TWO_JOINT_ARM,
        "six_joint_arm": SIX_JOINT_ARM,
        "diffdrive": WHEELS,
    }
)


def kind(name: str) -> Arm | Wheels:
    """The kind of that name; UsageError with those that there are."""
    if name not in KINDS:
        raise UsageError(
            f"robot {name!r} has no independent truth",
            expected=one_of(KINDS, name),
            do="choose one of these",
        )
    return KINDS[name]


def causes_of(name: str, physics: str) -> tuple[str, ...]:
    """Ids of the causes that a kind can hide: "same" physics as the library's, or "other"."""
    robot = kind(name)
    own = CAUSES_OF_WHEELS if isinstance(robot, Wheels) else CAUSES_OF_ARMS
    able = [c for c in CAUSES if c in own and len(robot.joints) >= CAUSES[c].joints]
    return tuple(c for c in able if CAUSES[c].same == (physics == "same"))


def sized(name: str, hidden: str, size: str, seed: int) -> dict[str, float]:
    """{parameter: value [SI]} of a cause in a kind, at a size; UsageError where the kind cannot have it."""
    robot = kind(name)
    _check(name, hidden)
    return drawn(hidden, size, robot.units, seed)


def _check(name: str, hidden: str) -> None:
    """UsageError where there is no such cause, or the kind cannot have it."""
    cause(hidden)
    able = (*causes_of(name, "same"), *causes_of(name, "other"))
    if hidden not in able:
        raise UsageError(
            f"cause {hidden!r} in a hidden {name!r}",
            expected=one_of(able, hidden),
            do="choose one of these",
        )


def log(truth: Truth, commands: Commands) -> np.ndarray:
    """(E, T+1, S) what the sensors of a hidden robot say, in the order of its kind's `sensors`.

    Raises UsageError for kinds and causes that there are not, and where parameters or joints are not the kind's.
    """
    robot = kind(truth.kind)
    if truth.cause is not None:
        _check(truth.kind, truth.cause)
    unknown = set(truth.joints) - set(robot.joints)
    if unknown:
        raise UsageError(
            f"a hidden {truth.kind!r} has no joint {min(unknown)!r}",
            expected=f"some of {quoted(robot.joints)}",
            do="correct it",
        )
    try:
        true = robot.states(truth, commands)
    except KeyError as missing:
        raise UsageError(
            f"a hidden {truth.kind!r} without {missing.args[0]!r}",
            expected="a value for every parameter of the robot and of the cause",
            do="add it",
        ) from None
    return true if truth.exact else read(robot.sensors, true, stream(truth.seed, "truth sensors"))
