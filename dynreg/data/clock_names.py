"""What tables call their clocks, and the unit of time that such a name states."""

import re
from collections.abc import Iterable

UNITS_OF_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s]
# Of clocks, in small letters, the likeliest first. __time is PlotJuggler's, _time that of InfluxDB.
TIME_NAMES = (
    *("time", "timestamp", "t", "t_s", "time_s", "stamp", "timestamps", "times", "__time", "_time"),
    *("header.stamp", "header/stamp", "header_stamp", "datetime", "elapsed", "elapsed_time", "time_elapsed"),
)
NANOSECONDS = "%time"  # of `rostopic echo -p`
CLOCK_WORDS = frozenset(
    ("time", "times", "timestamp", "timestamps", "stamp", "stamps", "t")
)  # of other clocks
LONGER = {  # units that are not read, as headers write them: [s]
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600),
}
_WRITTEN = {  # units as headers write them, in small letters (of "µ" that is the Greek one)
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("μs", "μsec", "μsecs"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), "ns"),
}
# Units that are clocks without another word. Not "second": it may be that of a minute.
_ALONE = {word: unit for word, unit in _WRITTEN.items() if len(word) > 2 and word[-1] == "s"} | {"sec": "s"}
_BRACKETED = re.compile(r"(.*?)[\s_]*[\[(]\s*([^\[\]()]+?)\s*[\])]")
_LAST = re.compile(r"(.*?)(?:[\s_./,:-]+|(?<=[a-z])(?=[A-Z]))([^\W\d_]+)")


def stated_unit(name: str) -> str | None:
    """The unit that the name of a clock states; None where it states none, or is no clock's.

    >>> stated_unit("time_ms"), stated_unit("Time [µs]"), stated_unit("time"), stated_unit("torque [ms]")
    ('ms', 'us', None, None)
    """
    if name.lower() == NANOSECONDS:
        return "ns"
    stem, written = _parted(name)
    if not stem:
        return (_WRITTEN if "[" in name or "(" in name else _ALONE).get(written)
    return _WRITTEN.get(written) if stem in TIME_NAMES else None


def unit_at_end(name: str) -> str | None:
    """The unit of time with which a name ends, whatever it is called besides; None where it ends with none.

    >>> unit_at_end("cmd_time_ms"), unit_at_end("ticks [µs]"), unit_at_end("ticks")
    ('ms', 'us', None)
    """
    return stated_unit(name) or _WRITTEN.get(_parted(name)[1])


def longer_unit(name: str) -> str | None:
    """The unit with which a name ends where that is one that is not read; else None.

    >>> longer_unit("Time [min]"), longer_unit("time_s")
    ('min', None)
    """
    written = _parted(name)[1]
    return written if written in LONGER else None


def is_clock(name: str) -> bool:
    """Whether a column's name is a usual one of a clock, in small letters or large ones."""
    told = name.lower() in TIME_NAMES or stated_unit(name) is not None
    return told or bool(longer_unit(name)) and _parted(name)[0] in TIME_NAMES


def halves(names: Iterable[str]) -> tuple[str, str] | None:
    """The columns of whole seconds and of the nanoseconds to be added, where a log's stamps are in two; else None.

    >>> halves(["header.stamp.secs", "header.stamp.nsecs", "q"]), halves(["secs", "q"])
    (('header.stamp.secs', 'header.stamp.nsecs'), None)
    """
    every = {name.lower(): name for name in names}
    for plain, name in every.items():
        for whole in ("secs", "sec", "seconds"):
            stem = plain.removesuffix(whole)
            if stem == plain or stem and stem[-1].isalnum():
                continue
            for rest in ("nsecs", "nsec", "nanosec", "nanosecs", "nanoseconds"):
                if stem + rest in every:
                    return name, every[stem + rest]
    return None


def likelihood(name: str) -> tuple[int, int]:
    """What sorts the names of clocks, the likeliest first; a T comes last, for it may be a temperature."""
    plain, every = name.lower(), len(TIME_NAMES)
    if name == "T":
        return 2 * every + 1, 0
    if plain in TIME_NAMES:
        return TIME_NAMES.index(plain), 0
    stem = _parted(name)[0]
    place = TIME_NAMES.index(stem) if stem in TIME_NAMES else every * (plain != NANOSECONDS)
    return every + place, [*UNITS_OF_TIME, None].index(stated_unit(name))


def _parted(name: str) -> tuple[str, str]:
    """The words before a unit, joined by "_", and what may be one, in small letters.

    >>> _parted("Elapsed Time (sec)"), _parted("timeMs"), _parted("[msec]"), _parted("seconds")
    (('elapsed_time', 'sec'), ('time', 'ms'), ('', 'msec'), ('', 'seconds'))
    """
    plain = name.strip()
    found = _BRACKETED.fullmatch(plain) or _LAST.fullmatch(plain)
    stem, written = (found[1], found[2]) if found else ("", plain)
    return re.sub(r"[\s_]+", "_", stem.strip()).lower(), written.casefold()
