"""A log as it was read: every numeric signal under its source name, before any robot is known."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dynreg.errors import LogError

STAMP_TOLERANCE = 1e-6  # [s] a command stamped this much after a grid point still counts for it


@dataclass(frozen=True)
class Finding:
    """One thing that a check saw in a log.

    Attributes
    ----------
    severity : "error" blocks ingestion, "warning" goes to the provenance, "info" is only told.
    check : stable name of the check ("clock", "gap", "units", ...).
    where : file, channel and time or row.
    message : what was seen, one line. do : what to do about it; "" where there is nothing. Recordings that were stored
        before it had a place of its own have it at the end of the message.
    """

    severity: Literal["error", "warning", "info"]
    check: str
    where: str
    message: str
    do: str = ""

    @property
    def told(self) -> str:
        """What was seen and what to do, in one line.

        >>> Finding("warning", "wrap", "run.csv, arm", "jumps by a whole turn once", "set unwrap = true").told
        'jumps by a whole turn once; set unwrap = true'
        """
        return f"{self.message}; {self.do}" if self.do else self.message

    def __str__(self) -> str:
        return f"{self.severity} [{self.check}] {self.where}: {self.told}"


def once(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """What is found alike in several places as one finding: the first place, and how many more.

    >>> [one.where for one in once(Finding("info", "gap", where, "long") for where in ("a", "b", "c"))]
    ['a and 2 places more']
    >>> [one.where for one in once(Finding("info", "gap", where, "long") for where in "ab")]
    ['a and 1 place more']
    """
    places: dict[Finding, list[str]] = {}
    for f in findings:
        places.setdefault(replace(f, where=""), []).append(f.where)
    return tuple(replace(f, where=where[0] + _more(len(where) - 1)) for f, where in places.items())


def _more(places: int) -> str:
    return f" and {places} {'place' if places == 1 else 'places'} more" if places else ""


@dataclass(frozen=True)
class Series:
    """One signal over time, in the order in which it was logged.

    Attributes
    ----------
    time : (T,) seconds since the log's first stamp. Not yet checked: it may stop or run back.
    values : (T,) float64; NaN where the log holds none.
    unit : the unit that the log itself states, or None.
    error : of a rate that was computed from another signal, 1 sigma in its unit, NaN where that is not known; None of
        what was logged. What a rate does not tell is not filled in by the rows beside it.
    """

    time: np.ndarray
    values: np.ndarray
    unit: str | None = None
    error: float | None = None

    def __post_init__(self):
        time = np.ascontiguousarray(self.time, dtype=np.float64)
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        if time.ndim != 1 or time.shape != values.shape:
            raise LogError(
                f"a series has time of shape {time.shape} and values of shape {values.shape}",
                expected="both of shape (T,)",
                do="pass one value for each time stamp",
            )
        time.setflags(write=False)
        values.setflags(write=False)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.time)

    def rows(self, keep: np.ndarray | slice) -> "Series":
        """The same signal at some of its rows."""
        return replace(self, time=self.time[keep], values=self.values[keep])


def clean(series: Series) -> Series:
    """Rows with a finite value on strictly increasing stamps; the last row of equal stamps is kept."""
    series = series.rows(np.isfinite(series.values) & np.isfinite(series.time))
    if len(series) < 2:
        return series
    return series.rows(np.append(np.diff(series.time) > 0, True))


@dataclass(frozen=True)
class Counting:
    """How the clock of a table counts.

    unit : "s", "ms", "us" or "ns", in which it was read. told : what tells it: the "map", the "name" of the column,
    "dates" in it or its "steps"; "" where seconds are taken for granted. column : its name.
    """

    unit: str = "s"
    told: Literal["map", "name", "dates", "steps", ""] = ""
    column: str = "time"


SECONDS = Counting()


@dataclass(frozen=True)
class RawLog:
    """A log as read.

    Attributes
    ----------
    path : the file or directory.
    sources : signals by source name: "topic.field[index]" of messages, the column's name of tables.
    metadata : settings found in the log (a gain, a mass); `start` [s] is the first stamp in absolute time.
    labels : text columns of tables, (T,) each, in the table's row order: names of episodes.
    findings : what the reader itself saw (lost messages, a damaged chunk).
    names : of every signal that the log holds, also where only those asked for are in `sources`.
    stem : its name without a file's suffix; a folder has none. Where it is not told, that of a file.
    """

    path: Path
    sources: Mapping[str, Series]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    labels: Mapping[str, np.ndarray] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    names: tuple[str, ...] = ()
    stem: str = ""

    def __post_init__(self):
        object.__setattr__(self, "stem", self.stem or self.path.stem)
        object.__setattr__(self, "names", tuple(self.names) or (*self.labels, *self.sources))

    @property
    def start(self) -> float:
        """The first stamp in absolute time [s]; 0 where the log does not tell it."""
        return float(self.metadata.get("start", 0.0))

    @property
    def counting(self) -> Counting | None:
        """How its clock counts; None of messages, whose stamps tell."""
        if "time_column" not in self.metadata:
            return None
        told = self.metadata.get("time_unit_told", "")
        return Counting(self.metadata["time_unit"], told, self.metadata["time_column"])

    def counted_in(self, unit: str, factor: float) -> "RawLog":
        """The log of a table whose clock counts in another unit than it was read in, by its steps.

        factor : seconds in one, for each second that was read.
        """
        told = {"start": self.start * factor, "time_unit": unit, "time_unit_told": "steps"}
        sources = {name: replace(s, time=s.time * factor) for name, s in self.sources.items()}
        return replace(self, sources=sources, metadata={**self.metadata, **told})

    def topic_of(self, source: str) -> str:
        """The topic of a signal, "" in tables; of many things in one topic theirs, such as "/tf[odom->base_link]"."""
        topics = self.metadata.get("topics") or ()
        topic = max((t for t in topics if source.startswith((f"{t}.", f"{t}["))), key=len, default="")
        return source[: source.index("]") + 1] if topic and source[len(topic)] == "[" else topic

    def stamped(self) -> "RawLog":
        """The log without the rows that have no time stamp, and a finding that counts them."""
        bare = {name: ~np.isfinite(s.time) for name, s in self.sources.items()}
        name = next((name for name, rows in bare.items() if rows.any() and not rows.all()), None)
        if name is None:
            return self
        count, row = int(bare[name].sum()), int(np.argmax(bare[name]))
        told = "1 row has no time stamp and is" if count == 1 else f"{count} rows have no time stamp and are"
        found = Finding("warning", "clock", f"{self.path.name}, {name}, row {row}", f"{told} left out")
        labels = {
            key: texts[~bare[name]] if len(texts) == len(bare[name]) else texts
            for key, texts in self.labels.items()
        }
        sources = {key: s.rows(~bare[key]) if not bare[key].all() else s for key, s in self.sources.items()}
        return replace(self, sources=sources, labels=labels, findings=(*self.findings, found))
