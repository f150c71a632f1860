"""All topics of a log of messages; what one message tells of several things at several times is taken apart."""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.messages import FOREIGN_CLOCK, Topic, get, header_stamp
from dynreg.data.readers.numbers import number
from dynreg.data.readers.signals import MAX_ITEMS
from dynreg.data.series import Finding, RawLog, Series
from dynreg.errors import MapError

TRAJECTORY = {
    "positions": "position",
    "velocities": "velocity",
    "accelerations": "acceleration",
    "effort": "effort",
}
PLANNED = 60.0  # [s] a trajectory that begins further than this from when it was logged has a stamp of another clock
MAX_POINTS = 4096  # most points of one trajectory
MOST = 1000  # rows from one point to the next, however far they are apart
FINE = 0.01  # [s] between rows of the straight line from one point of a trajectory to the next


class Topics:
    """The messages of a log, topic by topic.

    The transforms of a tf message are besides topics of their own, "/tf[odom->base_link]", on their own stamps; the
    points of a JointTrajectory are besides the topic "/topic.point", each where it is to be reached.
    """

    def __init__(self, options: ReadOptions, budget: Budget):
        self._options, self._budget = options, budget
        self._topics: dict[str, Topic] = {}
        self._plans: dict[str, _Plan] = {}
        self._types: dict[str, str] = {}
        self._counts: Counter[str] = Counter()

    def __bool__(self) -> bool:
        return bool(self._topics)

    def add(self, name: str, message: Any, stamp: int, kind: str = "") -> None:
        """Take a decoded message of topic `name` and type `kind`, logged at `stamp` [ns]; raises as `Topic.add`."""
        self._types.setdefault(name, kind)
        self._counts[name] += 1
        self._topic(name).add(message, stamp)
        for transform in _items(message, "transforms"):
            frames = get(get(transform, "header"), "frame_id"), get(transform, "child_frame_id")
            tree = f"{name}[{frames[0]}->{frames[1]}]"
            if all(map(_is_text, frames)) and self._options.wants(tree):
                self._topic(tree).add(transform, stamp)
        joints = get(message, "joint_names") if self._options.wants(f"{name}.point") else None
        if isinstance(joints, list | tuple) and 0 < len(joints) <= MAX_ITEMS and all(map(_is_text, joints)):
            plan = self._plans.setdefault(name, _Plan())
            points = _items(message, "points")
            for at, point in plan.take(list(joints), points, _begins(message, stamp)):
                self._topic(f"{name}.point").add(point, at)

    def log(self, path: Path) -> RawLog:
        """All topics on one clock that starts with the first message.

        Raises MapError where the map names a column as that clock.
        """
        if self._options.time not in (None, "log"):
            raise MapError(
                f"{path.name!r} is a log of messages, and the map names column {self._options.time!r} as its clock",
                expected='time = "log", the recorder\'s stamps, or none: those in headers',
                do="leave `time` under [map] out",
            )
        use_header = self._options.time != "log"
        for name, plan in self._plans.items():
            for at, point in plan.rest():
                self._topic(f"{name}.point").add(point, at)
        whole = [self._topics[name] for name in self._types]
        start = min((min(t.log_stamps) for t in whole if t.log_stamps), default=0)
        sources: dict[str, Series] = {}
        findings: list[Finding] = []
        # headers of one robot share a clock: those that come soonest tell how far it is ahead
        lags = [lag for t in self._topics.values() if abs(lag := t.lag) <= FOREIGN_CLOCK]
        for topic in self._topics.values():
            series, found = topic.log(start, use_header, max(lags, default=0.0))
            sources.update(series)
            findings += found
        names = tuple(name for topic in self._topics.values() for name in topic.names)
        told = {"start": start * 1e-9, "types": dict(self._types), "messages": dict(self._counts)}
        return RawLog(path, sources, told, findings=tuple(findings), names=names)

    def _topic(self, name: str) -> Topic:
        if name not in self._topics:
            self._topics[name] = Topic(name, self._options, self._budget)
        return self._topics[name]


class _Plan:
    """The points of one topic's trajectories that are still ahead; a new trajectory takes the place of the old."""

    def __init__(self):
        self._joints: list[str] = []
        self._knots: list[
            tuple[int, dict[str, np.ndarray]]
        ] = []  # the first is where the robot was told to be

    def take(
        self, joints: list[str], points: list[Any], begin: int
    ) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Rows of what was ahead, until a trajectory takes over at `begin` [ns]; then its points are ahead."""
        last = None
        for last in self._rows(begin):
            yield last
        knots = (
            [(begin, {k: np.array(v) for k, v in last[1].items() if k != "name"})]
            if last
            else self._knots[:1]
        )
        self._knots = knots if joints == self._joints else []
        self._joints = joints
        for point in points:
            after = _nanoseconds(get(point, "time_from_start"))
            told = {name: _numbers(get(point, key), len(joints)) for key, name in TRAJECTORY.items()}
            told = {name: values for name, values in told.items() if values is not None}
            if told and after >= 0 and begin + after < 2**63:
                if self._knots and self._knots[-1][0] == begin + after:
                    self._knots.pop()  # at once: nothing leads there
                self._knots.append((begin + after, told))

    def rest(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """What is left at the end of the log."""
        return self._rows(2**63)

    def _rows(self, end: int) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Stamps [ns] before `end`, and what is commanded there: straight lines from knot to knot."""
        before = None
        for at, told in self._knots:
            pieces = 1
            if before is not None and at > before[0]:
                pieces = min(max(round((at - before[0]) * 1e-9 / FINE), 1), MOST)
            for piece in range(1, pieces + 1):
                share = piece / pieces
                stamp = at if before is None else before[0] + round((at - before[0]) * share)
                if stamp >= end:
                    return
                known = {
                    n: v if piece == pieces else _between(before[1].get(n), v, share) for n, v in told.items()
                }
                yield stamp, {"name": self._joints, **{n: v.tolist() for n, v in known.items()}}
            before = (at, told)


def _between(one: np.ndarray | None, other: np.ndarray, share: float) -> np.ndarray:
    return other if one is None else one + share * (other - one)


def _numbers(values: Any, count: int) -> np.ndarray | None:
    """One number for each joint, or None."""
    if not isinstance(values, list | tuple | np.ndarray) or len(values) != count:
        return None
    numbers = [number(value) for value in values]
    return None if None in numbers else np.array(numbers, dtype=np.float64)


def _nanoseconds(duration: Any) -> int:
    """A ROS duration, also as JSON has it; -1 where it is none."""
    seconds = next((s for s in (get(duration, "sec"), get(duration, "secs")) if s is not None), None)
    told = (get(duration, key) for key in ("nanosec", "nanosecs", "nsec", "nsecs"))
    nanos = next((n for n in told if n is not None), 0)
    return seconds * 10**9 + nanos if isinstance(seconds, int) and isinstance(nanos, int) else -1


def _items(message: Any, field: str) -> list[Any]:
    """The items of a list in a message; none of what is no list, or too long for one of signals."""
    items = get(message, field)
    return list(items) if isinstance(items, list | tuple) and len(items) <= MAX_POINTS else []


def _begins(message: Any, stamp: int) -> int:
    """When a trajectory begins [ns]: at its header's stamp where that is one, else when it was logged."""
    told = header_stamp(message)
    return told if told is not None and told >= 0 and abs(told - stamp) * 1e-9 < PLANNED else stamp


def _is_text(value: Any) -> bool:
    return isinstance(value, str)
