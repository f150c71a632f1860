"""From decoded messages of any encoding to one series a numeric leaf."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np

from dynreg.data.series import Finding, Series

MAX_ITEMS = 64  # longer arrays are images, scans and point clouds, not signals
MAX_DEPTH = 16
MAX_LEAVES = 4096
JOINT_STATE = ("position", "velocity", "effort")
FOREIGN_CLOCK = 60.0  # [s] header stamps further than this from the log's own are of another clock

Leaf = float | np.ndarray


def leaves(message: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, Leaf]]:
    """Numeric leaves of a message: (".pose.position.x", 1.5), (".effort", array of shape (n,)).

    Understands dataclasses (ROS), mappings and lists (JSON) and protobuf messages. Text, bytes and arrays of
    more than 64 items are left out; True is 1.
    """
    if isinstance(message, float):
        yield path, message
    elif isinstance(message, int | np.number | np.bool_):  # bool is an int
        try:
            yield path, float(message)
        except OverflowError:  # an integer beyond a double, which JSON permits
            return
    elif message is None or isinstance(message, str | bytes | bytearray) or depth > MAX_DEPTH:
        return
    elif isinstance(message, np.ndarray):
        if message.ndim == 1 and 0 < message.size <= MAX_ITEMS and message.dtype.kind in "biuf":
            yield path, message
    elif is_dataclass(message):
        for suffix, getter in _fields(type(message)):
            yield from leaves(getter(message), path + suffix, depth + 1)
    elif isinstance(message, Mapping):
        for name, value in message.items():
            yield from leaves(value, f"{path}.{name}", depth + 1)
    elif hasattr(message, "DESCRIPTOR"):
        for field in message.DESCRIPTOR.fields:
            yield from leaves(getattr(message, field.name), f"{path}.{field.name}", depth + 1)
    else:
        yield from _items(message, path, depth)


def _items(sequence: Any, path: str, depth: int) -> Iterator[tuple[str, Leaf]]:
    try:
        count = len(sequence)
    except TypeError:
        return
    if 0 < count <= MAX_ITEMS:
        for i, item in enumerate(sequence):
            yield from leaves(item, f"{path}[{i}]", depth + 1)


@cache
def _fields(cls: type) -> tuple[tuple[str, attrgetter], ...]:
    return tuple((f".{f.name}", attrgetter(f.name)) for f in fields(cls) if not f.name.startswith("__"))


def get(message: Any, name: str) -> Any:
    """Field of a decoded message, or None."""
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def header_stamp(message: Any) -> int | None:
    """`header.stamp` [ns], or None where there is none or it is zero."""
    stamp = get(get(message, "header"), "stamp")
    seconds = get(stamp, "sec") if get(stamp, "sec") is not None else get(stamp, "secs")
    told = (get(stamp, key) for key in ("nanosec", "nanosecs", "nsec", "nsecs"))
    nanos = next((n for n in told if n is not None), 0)
    if not isinstance(seconds, int) or not isinstance(nanos, int):
        return None
    return (seconds * 10**9 + nanos) or None


def is_joint_state(message: Any) -> bool:
    """Whether a message has the fields of sensor_msgs/JointState."""
    names = get(message, "name")
    return (
        isinstance(names, list | tuple)
        and 0 < len(names) <= MAX_ITEMS
        and all(isinstance(n, str) for n in names)
        and any(get(message, f) is not None for f in JOINT_STATE)
    )


class Topic:
    """The messages of one topic, gathered leaf by leaf."""

    def __init__(self, name: str):
        self.name = name
        self.log_stamps: list[int] = []
        self.header_stamps: list[int | None] = []
        self._leaves: dict[str, tuple[list[int], list[Leaf]]] = {}

    def add(self, message: Any, log_stamp: int) -> None:
        """Take one decoded message that was logged at `log_stamp` [ns]."""
        row = len(self.log_stamps)
        self.log_stamps.append(int(log_stamp))
        self.header_stamps.append(header_stamp(message))
        for path, value in leaves(message):
            if path in self._leaves or len(self._leaves) < MAX_LEAVES:
                self._keep(path, row, value)
        # By name as well as by index: the order of the joints may change from message to message.
        for field in JOINT_STATE if is_joint_state(message) else ():
            values, names = get(message, field), get(message, "name")
            if isinstance(values, list | tuple | np.ndarray) and len(values) == len(names):
                for joint, value in zip(names, values, strict=True):
                    self._keep(f".{field}[{joint}]", row, float(value))

    def _keep(self, path: str, row: int, value: Leaf) -> None:
        rows, values = self._leaves.setdefault(path, ([], []))
        # A JSON field may be a number in one message and a list in the next: the first kind stands.
        if not values or isinstance(values[0], np.ndarray) == isinstance(value, np.ndarray):
            rows.append(row)
            values.append(value)

    def series(self, start: int, use_header: bool) -> tuple[dict[str, Series], list[Finding]]:
        """One series a leaf, with time in seconds since `start` [ns]."""
        time, findings = self._clock(start, use_header)
        out: dict[str, Series] = {}
        for path, (rows, values) in self._leaves.items():
            at = time[rows]
            if not isinstance(values[0], np.ndarray):
                out[self.name + path] = Series(at, np.array(values, dtype=float))
                continue
            for i, (has, column) in enumerate(_items_of_arrays(values)):
                out[f"{self.name}{path}[{i}]"] = Series(at[has], column)
        return out, findings

    def _clock(self, start: int, use_header: bool) -> tuple[np.ndarray, list[Finding]]:
        # Differences are taken in whole nanoseconds: an absolute stamp in float64 is only good to 0.2 us.
        log = np.array([s - start for s in self.log_stamps], dtype=object).astype(np.float64) * 1e-9
        stamped = [s is not None for s in self.header_stamps]
        if not use_header or not all(stamped):
            return log, []
        header = np.array([h - start for h in self.header_stamps], dtype=object).astype(np.float64) * 1e-9
        lag = float(np.median(header - log))
        if abs(lag) <= FOREIGN_CLOCK:
            return header, []
        finding = Finding(
            "warning",
            "clock",
            self.name,
            f"header stamps are {lag:.0f} s from the log's clock; shifted by their median difference",
        )
        return header - lag, [finding]


def _items_of_arrays(arrays: list[np.ndarray]) -> Iterator[tuple[np.ndarray | slice, np.ndarray]]:
    """Item by item, the arrays that are long enough to have it and its values."""
    lengths = np.array([len(a) for a in arrays])
    if np.all(lengths == lengths[0]):
        stacked = np.stack(arrays).astype(float)
        yield from ((slice(None), stacked[:, i]) for i in range(lengths[0]))
        return
    for i in range(int(lengths.max())):
        has = np.flatnonzero(lengths > i)
        yield has, np.array([arrays[k][i] for k in has], dtype=float)


def gather(
    topics: Mapping[str, Topic], use_header: bool
) -> tuple[dict[str, Series], dict[str, Any], list[Finding]]:
    """All topics of a log on one clock that starts with its first message."""
    start = min((min(t.log_stamps) for t in topics.values() if t.log_stamps), default=0)
    sources: dict[str, Series] = {}
    findings: list[Finding] = []
    for topic in topics.values():
        series, found = topic.series(start, use_header)
        sources.update(series)
        findings += found
    return sources, {"start": start * 1e-9}, findings
