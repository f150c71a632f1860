"""The numbers of messages, kept as numbers: 8 bytes each, and which messages held them only where some did not."""

from array import array
from collections.abc import Iterator

import numpy as np

from dynreg.data.series import Series

MAX_ITEMS = 64  # of an array: longer ones are images, scans and point clouds, not signals


class Signal:
    """One number a message, or as many as an array of one length has."""

    def __init__(self, row: int, width: int = 1):
        self.width = width
        self._first, self._count = row, 0
        self._values = array("d")
        self._rows: array | None = None

    def add(self, row: int, value: float) -> None:
        """Take the number of message `row`."""
        self._enter(row)
        self._values.append(value)

    def add_array(self, row: int, values: np.ndarray) -> None:
        """Take the array of message `row`."""
        self._enter(row)
        self._values.frombytes(values.astype(np.float64).tobytes())

    def series(self, time: np.ndarray) -> Series:
        """The numbers, with the time of their messages."""
        return Series(time[self.rows], np.frombuffer(self._values))

    @property
    def table(self) -> np.ndarray:
        """(N, width) the arrays."""
        return np.frombuffer(self._values).reshape(-1, self.width)

    @property
    def rows(self) -> slice | np.ndarray:
        """Which messages held them."""
        if self._rows is None:
            return slice(self._first, self._first + self._count)
        return np.frombuffer(self._rows, dtype=np.uint32)

    def _enter(self, row: int) -> None:
        if self._rows is None and row != self._first + self._count:
            self._rows = array("I", range(self._first, self._first + self._count))
        if self._rows is not None:
            self._rows.append(row)
        self._count += 1


class Arrays:
    """Arrays whose length may change from message to message, item by item.

    items : (K,) those that are asked for. longest : the most items that a message had.
    """

    def __init__(self, items: np.ndarray, longest: int = 0):
        self.longest = longest
        self._items = items
        self._every = len(items) and len(items) == items[-1] + 1 >= longest  # asked for whole, as a rule
        self._by_length: dict[int, Signal] = {}

    def add(self, row: int, values: np.ndarray) -> int:
        """Take the array of message `row`; gives how many numbers of it are kept."""
        self.longest = max(self.longest, len(values))
        kept = values if self._every else values[self._items[self._items < len(values)]]
        if len(kept):
            self._by_length.setdefault(len(values), Signal(row, len(kept))).add_array(row, kept)
        return len(kept)

    def series(self, time: np.ndarray) -> Iterator[tuple[int, Series]]:
        """Each item that is asked for and that was there, and its series."""
        every = np.arange(len(time))
        for place, item in enumerate(self._items.tolist()):
            held = [signal for length, signal in self._by_length.items() if length > item]
            if len(held) == 1:
                yield item, Series(time[held[0].rows], held[0].table[:, place])
            elif held:
                rows = np.concatenate([every[signal.rows] for signal in held])
                values = np.concatenate([signal.table[:, place] for signal in held])
                order = np.argsort(rows, kind="stable")
                yield item, Series(time[rows[order]], values[order])
