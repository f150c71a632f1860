"""The words of names, in logs and of robots: what they say is measured, of which joint, and in which unit."""

import re
from collections.abc import Sequence

QUANTITIES = {
    "position": "position positions pos q qpos angle angles theta",
    "velocity": "velocity velocities vel qd dq qvel dot qdot thetadot speed omega rate",
    "torque": "torque torques trq tau effort efforts force",
    "voltage": "voltage volts volt",
    "duty": "duty pwm",
    "current": "current currents amps",
    "enable": "enable enabled",
    "acceleration": "acceleration acc qdd ddq ddot qddot thetaddot",
    "temperature": "temperature temp",
    "error": "error err",
}
COMMANDS = frozenset(
    "cmd cmds command commands commanded target targets goal goals desired des ref reference setpoint action actions "
    "trajectory ctrl control".split()
)
MEASURED = frozenset("meas measured actual present feedback state states".split())
UNIT_WORDS = {
    "deg": {"position": "deg", "velocity": "deg/s"},
    "degrees": {"position": "deg", "velocity": "deg/s"},
    "dps": {"velocity": "deg/s"},
    "rpm": {"velocity": "rpm"},
    "mm": {"position": "mm", "velocity": "mm/s"},
    "mv": {"voltage": "mV"},
    "ma": {"current": "mA"},
}
_NEUTRAL = MEASURED | frozenset(
    "joint joints sensor sensors observation obs data point points robot encoder controller pt rad s m nm n v "
    "a u servo".split()
)
_JOINT_WORDS = frozenset(("joint", "joints", "motor", "servo", "link", "actuator"))
_QUANTITY_OF = {word: quantity for quantity, words in QUANTITIES.items() for word in words.split()}


def words(text: str) -> tuple[str, ...]:
    """The words and numbers of a name, in small letters.

    >>> words("pos_FL_hip"), words("shoulderPan.qd2")
    (('pos', 'fl', 'hip'), ('shoulder', 'pan', 'qd', '2'))
    """
    return tuple(part.lower() for part in _parts(text))


def spelled(text: str, told: Sequence[str]) -> str:
    """Those words of a name that are among `told`, as they are written there, joined by "_".

    >>> spelled("pos_FL_hip", ("fl", "hip"))
    'FL_hip'
    """
    return "_".join(part for part in _parts(text) if part.lower() in told)


def _parts(text: str) -> list[str]:
    return re.findall(r"[A-Za-z]+|[0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text))


def asks(told: Sequence[str]) -> bool:
    """Whether words say that this is what was asked for: "u" says so where it comes first, as it does in control.

    >>> asks(("arm", "cmd")), asks(("u", "1")), asks(("phase", "u"))
    (True, True, False)
    """
    return not COMMANDS.isdisjoint(told) or tuple(told[:1]) == ("u",)


def quantity(told: Sequence[str], topic: str = "") -> str | None:
    """What words say is measured or commanded; those of the topic tell where the others do not.

    It is the last that they say, but the error of a position is an error wherever it is called so.

    >>> quantity(("theta", "dot")), quantity(("error", "positions"))
    ('velocity', 'error')
    """
    found = [_QUANTITY_OF[word] for word in told if word in _QUANTITY_OF]
    found = found or [_QUANTITY_OF[word] for word in words(topic) if word in _QUANTITY_OF]
    return "error" if "error" in found else found[-1] if found else None


def steady(name: str) -> bool:
    """Whether a signal of that name is measured and moves on: commands and errors jump, torques and velocities kick.

    >>> steady("pos_arm"), steady("cmd_arm"), steady("/imu.linear_acceleration.x")
    (True, False, False)
    """
    told = words(name)
    return not asks(told) and quantity(told) not in (
        "velocity",
        "torque",
        "current",
        "acceleration",
        "duty",
        "error",
    )


def strange(told: Sequence[str]) -> int:
    """How many words are neither a quantity, nor a command, nor a unit, nor said of any signal."""
    known = (*_QUANTITY_OF, *COMMANDS, *UNIT_WORDS, *_NEUTRAL)
    return sum(word not in known for word in told)


def core(joint: str) -> tuple[str, ...]:
    """The words of a joint's name that tell it from other joints.

    >>> core("FL_hip_joint"), core("joint_1"), core("panda_joint1")
    (('fl', 'hip'), ('1',), ('panda', '1'))
    """
    every = words(joint)
    return tuple(word for word in every if word not in _JOINT_WORDS) or every


def without(told: tuple[str, ...], part: tuple[str, ...]) -> tuple[str, ...] | None:
    """The words that are left where `part` is found among them in one piece; None where it is not.

    >>> without(("pos", "fl", "hip"), ("fl", "hip")), without(("pos", "fl"), ("hip",))
    (('pos',), None)
    """
    for begin in range(len(told) - len(part) + 1):
        if told[begin : begin + len(part)] == part:
            return told[:begin] + told[begin + len(part) :]
    return None
