"""Decoded messages of any encoding become series, one for each numeric leaf."""

import math
from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np

from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.numbers import number, since
from dynreg.data.readers.signals import MAX_ITEMS, Arrays, Signal
from dynreg.data.series import Finding, Series

MAX_DEPTH = 16
MAX_LEAVES = 4096  # most signals of one topic
MAX_PARTS = 16 * MAX_LEAVES  # most numbers and containers of one message
JOINT_STATE = ("position", "velocity", "effort")
FOREIGN_CLOCK = 60.0  # [s] header stamps further than this from the log's own are of another clock
# [s] no message is logged before it is stamped, by one clock: so far ahead is told, or put right; one that lies behind
# may have come late
AHEAD, SHIFTED = 0.05, 1.0

Leaf = float | int | np.number | np.bool_ | np.ndarray


def leaves(message: Any) -> list[tuple[str, Leaf]]:
    """Numeric leaves of a message: (".pose.position.x", 1.5), (".effort", array of shape (n,)).

    Understands dataclasses (ROS), mappings and lists (JSON) and protobuf messages. Text, bytes and arrays of
    more than 64 items are left out, and what lies deeper than 16 levels, or behind 65,536 other parts.
    """
    out: list[tuple[str, Leaf]] = []
    _gather_leaves("", message, 0, out, [MAX_PARTS])
    return out


def _gather_leaves(path: str, value: Any, depth: int, out: list[tuple[str, Leaf]], left: list[int]) -> None:
    if isinstance(value, float | int | np.number | np.bool_):  # bool is an int
        out.append((path, value))
    elif isinstance(value, np.ndarray):
        if value.ndim == 1 and 0 < value.size <= MAX_ITEMS and value.dtype.kind in "biuf":
            out.append((path, value))
    elif value is not None and not isinstance(value, str | bytes | bytearray) and depth <= MAX_DEPTH:
        for name, part in _parts(value):
            left[0] -= 1
            if left[0] < 0:
                return
            if type(part) is float:  # most are
                out.append((path + name, part))
            else:
                _gather_leaves(path + name, part, depth + 1, out, left)


def _parts(value: Any) -> list[tuple[str, Any]]:
    """The parts of a message, a mapping or a short list, by name."""
    if is_dataclass(value):
        return [(suffix, getter(value)) for suffix, getter in _fields(type(value))]
    if isinstance(value, Mapping):
        return [(f".{name}", part) for name, part in value.items()]
    if hasattr(value, "DESCRIPTOR"):
        return [(f".{f.name}", getattr(value, f.name)) for f in value.DESCRIPTOR.fields if _is_set(value, f)]
    try:
        return [(f"[{i}]", part) for i, part in enumerate(value)] if len(value) <= MAX_ITEMS else []
    except TypeError:
        return []


def _is_set(message: Any, field: Any) -> bool:
    """Whether a protobuf field holds something: one message in another that is not set would be made up, for ever."""
    return field.message_type is None or not field.has_presence or message.HasField(field.name)


@cache
def _fields(cls: type) -> tuple[tuple[str, attrgetter], ...]:
    return tuple((f".{f.name}", attrgetter(f.name)) for f in fields(cls) if not f.name.startswith("__"))


def get(message: Any, name: str) -> Any:
    """Field of a decoded message, or None."""
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def header_stamp(message: Any) -> int | None:
    """`header.stamp` [ns], or None where there is none or it is zero; -1 for one that is no time since 1970."""
    stamp = get(get(message, "header"), "stamp")
    seconds = get(stamp, "sec") if get(stamp, "sec") is not None else get(stamp, "secs")
    told = (get(stamp, key) for key in ("nanosec", "nanosecs", "nsec", "nsecs"))
    nanos = next((n for n in told if n is not None), 0)
    if seconds is None:
        return None
    if not isinstance(seconds, int) or not isinstance(nanos, int):
        return -1
    nanos += seconds * 10**9
    return (nanos or None) if 0 <= nanos < 2**63 else -1


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
    """The messages of one topic, gathered leaf by leaf: the signals that are asked for, the names of all."""

    def __init__(self, name: str, options: ReadOptions, budget: Budget):
        self.name = name
        self._options = options
        self._budget = budget
        self.log_stamps = array("Q")
        self._header_stamps = array("q")  # -1 where it is no time, -2 where there is none
        self._signals: dict[str, Signal | Arrays | None] = {}  # None: not asked for
        self._known = 0  # signals, items of arrays counted
        self._odd: Counter[str] = Counter()
        self._crowded = False
        self._kept = 0

    def add(self, message: Any, log_stamp: int) -> None:
        """Take one decoded message that was logged at `log_stamp` [ns], 0 to 2**64 - 1.

        Raises LogError past a limit, OverflowError for another stamp.
        """
        self._budget.spend("messages")
        row = len(self.log_stamps)
        self.log_stamps.append(int(log_stamp))
        stamp = header_stamp(message)
        self._header_stamps.append(-2 if stamp is None else stamp)
        for path, value in leaves(message):
            signal = self._signals.get(path)
            if type(value) is float and isinstance(signal, Signal):  # nearly all are
                signal.add(row, value)
                self._kept += 1
            elif isinstance(value, np.ndarray):
                self._keep_array(path, row, value)
            else:
                self._keep(path, row, value)
        # By name as well as by index: the order of the joints may change from message to message.
        for field in JOINT_STATE if is_joint_state(message) else ():
            values, names = get(message, field), get(message, "name")
            if isinstance(values, list | tuple | np.ndarray) and len(values) == len(names):
                for joint, value in zip(names, values, strict=True):
                    self._keep(f".{field}[{joint}]", row, value)
        self._budget.spend("numbers", self._kept)
        self._kept = 0

    def _keep(self, path: str, row: int, value: Any) -> None:
        if path not in self._signals and self._room(1):
            self._signals[path] = Signal(row) if self._options.wants_signal(self.name + path) else None
        signal = self._signals.get(path)
        if not isinstance(signal, Signal):
            return
        kept = number(value)
        if kept is None:
            self._odd[path] += 1
        self._kept += 1
        signal.add(row, math.nan if kept is None else kept)

    def _keep_array(self, path: str, row: int, values: np.ndarray) -> None:
        if path not in self._signals and self._room(len(values)):
            wanted = [self._options.wants_signal(f"{self.name}{path}[{i}]") for i in range(MAX_ITEMS)]
            self._signals[path] = Arrays(np.flatnonzero(wanted), len(values))
        arrays = self._signals.get(path)
        if isinstance(arrays, Arrays) and (
            len(values) <= arrays.longest or self._room(len(values) - arrays.longest)
        ):
            self._kept += arrays.add(row, values)

    def _room(self, more: int) -> bool:
        """Whether there is room for so many more signals."""
        if self._known + more > MAX_LEAVES:
            self._crowded = True
            return False
        self._known += more
        self._budget.spend("columns", more)
        return True

    @property
    def lag(self) -> float:
        """How far its header stamps are ahead of the log's [s], by their median; NaN where it has no such stamps."""
        stamps = np.frombuffer(self._header_stamps, dtype=np.int64)
        if not len(stamps) or not (stamps >= 0).all():
            return math.nan
        first = int(stamps[0])
        told, logged = (since(np.asarray(s, dtype=np.uint64), first) for s in (stamps, self.log_stamps))
        return float(np.median(told - logged)) * 1e-9

    def log(
        self, start: int, use_header: bool, ahead: float = 0.0
    ) -> tuple[dict[str, Series], list[Finding]]:
        """One series a signal, with time in seconds since `start` [ns], and what was seen.

        ahead : how far the clock of all headers of the log is ahead of the log's [s]; see `Topics.log`.
        """
        time, findings = self._clock(start, use_header, ahead)
        out: dict[str, Series] = {}
        for path, kept in self._signals.items():
            if isinstance(kept, Signal):
                out[self.name + path] = kept.series(time)
            elif kept is not None:
                out.update((f"{self.name}{path}[{i}]", series) for i, series in kept.series(time))
        if self._odd:
            path, count = next(iter(self._odd.items()))
            text = f"{count} of {len(out[self.name + path])} values are no number that can be kept: empty"
            more = f"; so are values of {len(self._odd) - 1} more" if len(self._odd) > 1 else ""
            findings.append(Finding("warning", "left_out", self.name + path, text + more))
        if self._crowded:
            text = f"more than {MAX_LEAVES} signals in one topic; those that come later are left out"
            findings.append(Finding("warning", "left_out", self.name, text))
        return out, findings

    @property
    def names(self) -> list[str]:
        """Every signal met, asked for or not."""
        every = ((path, s.longest if isinstance(s, Arrays) else None) for path, s in self._signals.items())
        return [
            self.name + path + item
            for path, count in every
            for item in ([""] if count is None else [f"[{i}]" for i in range(count)])
        ]

    def _clock(self, start: int, use_header: bool, ahead: float) -> tuple[np.ndarray, list[Finding]]:
        # Differences are taken in whole nanoseconds: an absolute stamp in float64 is only good to 0.2 us.
        log = since(np.frombuffer(self.log_stamps, dtype=np.uint64), start) * 1e-9
        stamps = np.frombuffer(self._header_stamps, dtype=np.int64)
        if not use_header or not (stamps >= 0).all():
            odd = int((stamps == -1).sum()) if use_header else 0
            text = f"{odd} header stamps are no time since 1970; the log's own stamps stand"
            return log, [Finding("warning", "clock", self.name, text)] if odd else []
        header = since(stamps, start) * 1e-9
        lag = float(np.median(header - log))
        if abs(lag) > FOREIGN_CLOCK:
            text = f"header stamps are {lag:.0f} s from the log's clock; shifted by their median difference"
            return header - lag, [Finding("warning", "clock", self.name, text)]
        if ahead > SHIFTED and lag > ahead - SHIFTED:  # of the same clock; one of another host may be right
            text = f"header stamps are {lag:.3g} s ahead of the log's clock; all headers are shifted by {ahead:.3g} s"
            return header - ahead, [Finding("warning", "clock", self.name, text)]
        if lag <= AHEAD:
            return header, []
        text = (
            f"header stamps are {lag:.3g} s ahead of the log's clock: the robot's clock and the recorder's differ. "
            "Topics without header stamps are early by that"
        )
        do = f'set delay = {-lag:.3g} for their channels in the map, or time = "log" under [map]'
        return header, [Finding("warning", "clock", self.name, text, do)]
