"""Gaits as joint commands: tables, logs, and a Python module that needs nothing else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Protocol

import numpy as np

from dynreg.data.names import joint_of
from dynreg.data.topics import joint_states, mcap
from dynreg.errors import UsageError
from dynreg.gait.family import Family
from dynreg.gait.table import JointTable, faded
from dynreg.sim.sets import is_limit

SLACK = 1e-7  # rad, and relative: what the digits of a document may add
SAME = 1e-9  # rad, between tables that say the same


@dataclass(frozen=True)
class Joint:
    """A joint that is told: its angle at rest, the robot's limits [rad, rad/s]; None where it states none."""

    action: str
    rest: float
    low: float | None
    high: float | None
    speed: float | None


class Table(Protocol):
    """A `JointTable` as a document holds it."""

    period: float | None
    times: Sequence[float]
    targets: Sequence[Sequence[float]]


class Played(Protocol):
    """A gait as a robot plays it, `rate` times a second for `seconds`, faded in over `ramp` [s]: a gait's document."""

    robot: str
    rate: float
    ramp: float
    seconds: float
    joints: Sequence[Joint]
    table: Table


def joints(space: Family) -> tuple[Joint, ...]:
    """The joints that gaits tell, in the order of the actions."""
    limit = lambda x: float(x) if np.isfinite(x) else None  # noqa: E731
    each = zip(space.actions, space.pose, space.low, space.high, space.speed, strict=True)
    return tuple(
        Joint(action, float(rest), limit(low), limit(high), limit(speed))
        for action, rest, low, high, speed in each
    )


def require_playable(gait: Played) -> None:
    """Check a gait that somebody may have changed by hand.

    Raises UsageError where a joint would pass one of its limits, or where a number is missing or not finite.
    """
    numbers = "finite numbers, times and rates above 0"
    for name in ("rate", "seconds", "ramp"):
        value = getattr(gait, name)
        if not 0.0 <= value < np.inf or (value == 0.0 and name != "ramp"):
            raise _unlike(gait.robot, f"{name} = {value}", numbers)
    table = _table(gait)
    rest = np.array([j.rest for j in gait.joints])
    _require_finite(gait, "rest", rest[None])
    away = np.abs(table.targets - rest)
    fastest = np.abs(table.rates())
    if gait.ramp:
        fastest = fastest + np.maximum(away[1:], away[:-1]) / gait.ramp
    elif away[0].max() > SLACK:
        what = f"{gait.joints[int(away[0].argmax())].action} would begin away from rest, without a ramp"
        raise _unlike(gait.robot, what, "a motion that begins at rest")
    for i, j in enumerate(gait.joints):
        least, most = table.targets[:, i].min(), table.targets[:, i].max()
        if (j.low is not None and least < j.low - SLACK) or (j.high is not None and most > j.high + SLACK):
            what = f"{j.action} would go from {least:.3f} to {most:.3f} rad"
            raise _unlike(gait.robot, what, f"{j.low} to {j.high} rad")
        if j.speed is not None and fastest[:, i].max() > j.speed * (1 + SLACK):
            what = f"{j.action} would turn at {fastest[:, i].max():.2f} rad/s"
            raise _unlike(gait.robot, what, f"at most {j.speed} rad/s")


def _require_finite(gait: Played, name: str, angles: np.ndarray) -> None:
    """UsageError where one of the angles (n, A) is not finite."""
    if len(lost := np.argwhere(~np.isfinite(angles))):
        action = gait.joints[lost[0, 1]].action
        raise _unlike(gait.robot, f"{name} of {action} = {angles[tuple(lost[0])]}", "finite numbers")


def _table(gait: Played) -> JointTable:
    """The table of a gait; UsageError where its times, angles or period do not fit together."""
    table, whole = (
        gait.table,
        "two or more times that rise from 0 to the period, an angle of each joint at each",
    )
    times = np.array(table.times, dtype=float)
    if len(times) < 2 or not (np.isfinite(times).all() and times[0] == 0.0 and (np.diff(times) > 0).all()):
        raise _unlike(gait.robot, "its times do not rise from 0", whole)
    if len(table.targets) != len(times) or {len(row) for row in table.targets} != {len(gait.joints)}:
        raise _unlike(gait.robot, "its table does not hold an angle of each joint at each time", whole)
    targets = np.array(table.targets, dtype=float).reshape(len(times), len(gait.joints))
    _require_finite(gait, "targets", targets)
    if table.period is not None and not (
        np.isclose(times[-1], table.period) and np.allclose(targets[0], targets[-1], atol=SLACK)
    ):
        raise _unlike(gait.robot, "its period does not end as it begins", whole)
    return JointTable(table.period, times, targets)


def require_own(space: Family, genes: Mapping[str, float], gait: Played) -> None:
    """UsageError where genes {name: value} cannot be run on a robot, or a gait states other limits than the robot's."""
    space.require(space.from_dict(genes))
    # older documents state a number that is no limit for a drive without one
    stated = [
        (j.action, j.rest, j.low, j.high, j.speed if j.speed is not None and is_limit(j.speed) else None)
        for j in gait.joints
    ]
    own = [astuple(joint) for joint in joints(space)]
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


def told(space: Family, genes: Mapping[str, float], gait: Played, times: np.ndarray) -> np.ndarray:
    """(T, A) joint commands [rad] at times (T,) [s].

    They are those of the genes, to the last bit, where nobody has changed the table; else those of the table.
    """
    vector = space.from_dict(genes)
    own, table = space.table(vector), _table(gait)
    if gait.ramp == space.ramp and own.targets.shape == table.targets.shape:
        alike = zip((own.times, own.targets), (table.times, table.targets), strict=True)
        if all(np.allclose(a, b, rtol=0.0, atol=SAME) for a, b in alike):
            return space.targets(vector[None], times)[0]
    return _commands(gait, table, times)


def commands(gait: Played) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and what the joints are told then (T, A) [rad], by the table of the gait."""
    times = np.arange(max(round(gait.seconds * gait.rate), 1)) / gait.rate
    return times, _commands(gait, _table(gait), times)


def _commands(gait: Played, table: JointTable, times: np.ndarray) -> np.ndarray:
    if not gait.ramp:
        return table.at(times)
    return faded(table.at(times), np.array([j.rest for j in gait.joints]), gait.ramp, times)


def csv(gait: Played) -> bytes:
    """A table of times and angles."""
    return csv_of([j.action for j in gait.joints], *commands(gait))


def csv_of(actions: Sequence[str], times: np.ndarray, told: np.ndarray) -> bytes:
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
    rows = ""
    for i, j in enumerate(gait.joints):
        angles = tuple(float(row[i]) for row in gait.table.targets)
        rows += f"    {joint_of(j.action)!r}: ({j.rest!r}, {j.low!r}, {j.high!r}, {angles!r}),\n"
    # names only as literals: a document of a stranger must not become a program
    times = tuple(float(t) for t in gait.table.times)
    return _MODULE.format(gait=gait, said=str(gait), times=times, rows=rows).encode()


_MODULE = '''\
"""Joint commands of a gait that dynreg found.

Needs nothing but Python 3. On the robot, give `play` what moves a joint:

    play(lambda joint, angle: servos[joint].write(angle))
"""

import bisect
import math
import time

ROBOT = {gait.robot!r}
FOUND = {said!r}
RATE = {gait.rate!r}  # commands a second
SECONDS = {gait.seconds!r}
RAMP = {gait.ramp!r}  # seconds from rest into the gait
PERIOD = {gait.table.period!r}  # seconds after which it begins again; None where it ends
TIMES = {times!r}  # seconds
# joint: (rest, lowest, highest, angles at TIMES), all rad; evenly in between
JOINTS = {{
{rows}}}


def targets(t):
    """{{joint: angle [rad]}} that the joints are told t seconds after the start, inside their limits."""
    begun = min(max(t / RAMP, 0.0), 1.0) if RAMP else 1.0
    at = t % PERIOD if PERIOD else min(max(t, 0.0), TIMES[-1])
    after = min(bisect.bisect_right(TIMES, at), len(TIMES) - 1)
    share = (at - TIMES[after - 1]) / (TIMES[after] - TIMES[after - 1])
    told = {{}}
    for joint, (rest, low, high, angles) in JOINTS.items():
        angle = angles[after - 1] + share * (angles[after] - angles[after - 1])
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
        back = min(max(0.0, t - seconds) / RAMP, 1.0) if RAMP else 0.0
        for joint, angle in targets(min(t, seconds)).items():
            move(joint, angle + back * (JOINTS[joint][0] - angle))


if __name__ == "__main__":
    play(lambda joint, angle: print(f"{{joint}} {{angle:.4f}}"))
'''

FORMS: Mapping[str, Callable[[Played], bytes]] = {"csv": csv, "mcap": log, "python": module}
