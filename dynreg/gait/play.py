"""Gaits as joint commands: tables, logs, and a Python module that needs nothing else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Protocol

import numpy as np

from dynreg.data.names import joint_of
from dynreg.errors import UsageError
from dynreg.gait.family import SLACK
from dynreg.gait.runs import joint_states, mcap
from dynreg.gait.sines import Sines


@dataclass(frozen=True)
class Sine:
    """What one joint is told [rad]: offset + amplitude sin(2 pi frequency t + phase), faded in from `rest`.

    low, high [rad], speed [rad/s] : the robot's limits, None where it states none.
    """

    action: str
    rest: float
    offset: float
    amplitude: float
    phase: float
    low: float | None
    high: float | None
    speed: float | None


class Played(Protocol):
    """A gait as a robot plays it, `rate` times a second for `seconds`, faded in over `ramp` [s]: a gait's document."""

    robot: str
    frequency: float
    rate: float
    ramp: float
    seconds: float
    joints: Sequence[Sine]


def joints(space: Sines, genes: np.ndarray) -> tuple[Sine, ...]:
    """What a gait (G,) means for every joint, in the order of the actions; those of no leg stay at rest."""
    by_name = space.as_dict(genes)
    offset, amplitude, phase = space.pose.copy(), np.zeros(len(space.pose)), np.zeros(len(space.pose))
    for (leg, role), at in np.ndenumerate(space.columns):
        sign, name = space.signs[leg, role], space.roles[role]
        offset[at] = sign * by_name[f"offset_{name}"]
        amplitude[at] = sign * by_name[f"amplitude_{name}"]
        phase[at] = by_name[f"phase_{name}"] + by_name.get(f"phase_{space.legs[leg]}", 0.0)
    limit = lambda x: float(x) if np.isfinite(x) else None  # noqa: E731
    return tuple(
        Sine(
            action=action,
            rest=float(space.pose[i]),
            offset=float(offset[i]),
            amplitude=float(amplitude[i]),
            phase=float(phase[i]),
            low=limit(space.low[i]),
            high=limit(space.high[i]),
            speed=limit(space.speed[i]),
        )
        for i, action in enumerate(space.actions)
    )


def require_playable(gait: Played) -> None:
    """UsageError where a gait's joints would pass their limits, or a number is none, as after a change by hand."""
    numbers = "finite numbers, times and rates above 0"
    for name in ("frequency", "rate", "ramp", "seconds"):
        if not 0.0 < (value := getattr(gait, name)) < np.inf:
            raise _unlike(gait.robot, f"{name} = {value}", numbers)
    for j in gait.joints:
        for name in ("rest", "offset", "amplitude", "phase"):
            if not np.isfinite(value := getattr(j, name)):
                raise _unlike(gait.robot, f"{name} of {j.action} = {value}", numbers)
    for j in gait.joints:
        size = abs(j.amplitude)
        least, most = j.offset - size, j.offset + size
        if (j.low is not None and least < j.low - SLACK) or (j.high is not None and most > j.high + SLACK):
            what = f"{j.action} would go from {least:.3f} to {most:.3f} rad"
            raise _unlike(gait.robot, what, f"{j.low} to {j.high} rad")
        fastest = size * (2 * np.pi * gait.frequency + 1 / gait.ramp) + abs(j.offset - j.rest) / gait.ramp
        if j.speed is not None and fastest > j.speed + SLACK:
            what = f"{j.action} would turn at {fastest:.2f} rad/s"
            raise _unlike(gait.robot, what, f"at most {j.speed} rad/s")


def require_own(space: Sines, genes: Mapping[str, float], gait: Played) -> None:
    """UsageError where genes {name: value} cannot be run on a robot, or a gait states other limits than the robot's."""
    vector = space.from_dict(genes)
    space.require(vector)
    stated, own = (
        [(j.action, j.low, j.high, j.speed) for j in of] for of in (gait.joints, joints(space, vector))
    )
    if stated != own:
        wrong = next((a[0] for a, b in zip(stated, own, strict=False) if a != b), "the number of joints")
        expected = "the robot's own joints, with their limits of angle and rate"
        raise _unlike(space.robot, f"{wrong} is not stated as the robot has it", expected)


def _unlike(robot: str, what: str, expected: str) -> UsageError:
    """Of a gait that is not as it was found."""
    return UsageError(
        f"this gait cannot be run on robot {robot!r}: {what}",
        expected=expected,
        do="use the gait as `dynreg gait` found it",
    )


def told(space: Sines, genes: Mapping[str, float], gait: Played, times: np.ndarray) -> np.ndarray:
    """(T, A) joint commands at times (T,) [s]: to the last bit those of the genes, if nobody has changed the joints."""
    vector = space.from_dict(genes)
    own = [astuple(joint) for joint in joints(space, vector)]
    if own == [tuple(getattr(j, f.name) for f in fields(Sine)) for j in gait.joints]:
        return space.targets(vector[None], times)[0]
    return commands(gait)[1]


def commands(gait: Played) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and what the joints are told then (T, A) [rad]."""
    times = np.arange(max(round(gait.seconds * gait.rate), 1)) / gait.rate
    rest, offset, amplitude, phase = np.array(
        [(j.rest, j.offset, j.amplitude, j.phase) for j in gait.joints]
    ).T
    told = offset + amplitude * np.sin(2 * np.pi * gait.frequency * times[:, None] + phase)
    begun = np.clip(times / gait.ramp, 0.0, 1.0)[:, None]
    return times, rest + begun * (told - rest)


def csv(gait: Played) -> bytes:
    """A table of times and angles."""
    return table([j.action for j in gait.joints], *commands(gait))


def table(actions: Sequence[str], times: np.ndarray, told: np.ndarray) -> bytes:
    """Text with a column `time` [s] (T,) and one for each action (T, A)."""
    lines = [",".join(["time", *actions])]
    lines += [",".join([f"{t:.6f}", *(f"{q:.6f}" for q in row)]) for t, row in zip(times, told, strict=True)]
    return ("\n".join(lines) + "\n").encode()


def log(gait: Played) -> bytes:
    """JSON messages in the form of sensor_msgs/JointState on /joint_commands."""
    names = [joint_of(j.action) for j in gait.joints]
    return mcap([joint_states("/joint_commands", names, *commands(gait))])


def module(gait: Played) -> bytes:
    """A Python module that plays the gait."""
    rows = "".join(
        f"    {joint_of(j.action)!r}: {(j.rest, j.offset, j.amplitude, j.phase, j.low, j.high)!r},\n"
        for j in gait.joints
    )
    # names only as literals: a document of a stranger must not become a program
    return _MODULE.format(gait=gait, said=str(gait), rows=rows).encode()


_MODULE = '''\
"""Joint commands of a gait that dynreg found.

Needs nothing but Python 3. On the robot, give `play` what moves a joint:

    play(lambda joint, angle: servos[joint].write(angle))
"""

import math
import time

ROBOT = {gait.robot!r}
FOUND = {said!r}
FREQUENCY = {gait.frequency!r}  # Hz
RATE = {gait.rate!r}  # commands a second
SECONDS = {gait.seconds!r}
RAMP = {gait.ramp!r}  # seconds from rest into the gait
# joint: (rest, offset, amplitude, phase, lowest, highest), all rad
JOINTS = {{
{rows}}}


def targets(t):
    """{{joint: angle [rad]}} that the joints are told t seconds after the start, inside their limits."""
    begun = min(max(t / RAMP, 0.0), 1.0)
    told = {{}}
    for joint, (rest, offset, amplitude, phase, low, high) in JOINTS.items():
        angle = offset + amplitude * math.sin(2.0 * math.pi * FREQUENCY * t + phase)
        angle = rest + begun * (angle - rest)
        angle = angle if low is None else max(angle, low)
        told[joint] = angle if high is None else min(angle, high)
    return told


def play(move, seconds=SECONDS, clock=time.monotonic, sleep=time.sleep):
    """Call move(joint, angle) for every joint, RATE times a second, then go back to rest over RAMP seconds."""
    began = clock()
    for step in range(math.ceil((seconds + RAMP) * RATE - 1e-6) + 1):
        t = step / RATE
        sleep(max(0.0, began + t - clock()))
        back = min(max(0.0, t - seconds) / RAMP, 1.0)
        for joint, angle in targets(min(t, seconds)).items():
            move(joint, angle + back * (JOINTS[joint][0] - angle))


if __name__ == "__main__":
    play(lambda joint, angle: print(f"{{joint}} {{angle:.4f}}"))
'''

FORMS: Mapping[str, Callable[[Played], bytes]] = {"csv": csv, "mcap": log, "python": module}
