"""Where runs lie on a common clock: the one rule by which episodes are ordered, and by which rests are known."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynreg.data.series import Finding

TOLERANCE = 1e-3  # [s] by which one run may begin before another ends: absolute clocks are no better
ABSOLUTE = (
    1e8  # [s] stamps beyond it count from a common epoch (1970, 1980); nobody's bench runs for three years
)
TOLD = 3  # rests that a finding spells out, and overlaps that are told one by one
MOVED = "the logs are ordered by their clocks, not as they were given"
ANEW = (
    "each clock starts anew, so the rests between the episodes are not known: they follow each other in the order "
    "given"
)


@dataclass(frozen=True)
class Span:
    """One run on the clock of its log: begin and end [s], the number of the log, and what messages call the run."""

    begin: float
    end: float
    log: int
    name: str

    @property
    def absolute(self) -> bool:
        """Whether its clock counts from an epoch that other logs share, as against a start of its own."""
        return abs(self.begin) >= ABSOLUTE


@dataclass(frozen=True)
class Laid:
    """Runs in their order.

    order : numbers of the spans that were given. begins : (E,) [s] of the times of each, in that order. They begin at 0
    again where the rest before a run is not known. findings : what was assumed, and the rests between logs.
    """

    order: tuple[int, ...]
    begins: tuple[float, ...]
    findings: tuple[Finding, ...] = ()


def begins(first: np.ndarray, last: np.ndarray, pause: float = 0.0) -> np.ndarray:
    """(E,) seconds from the begin of the first run to that of each, from the first and last stamps (E,) of their times.

    A run whose time begins before that of the run before it has ended follows that one after `pause` [s]: the rest
    between the two is not known.

    >>> begins(np.array([0.0, 60.0, 0.0, 20.0]), np.array([10.0, 70.0, 10.0, 30.0]))
    array([ 0., 60., 70., 90.])
    """
    out, base, zero = np.zeros(len(first)), 0.0, first[0]
    for k in range(1, len(first)):
        if first[k] < last[k - 1] - TOLERANCE or first[k] <= first[k - 1]:
            base, zero = out[k - 1] + (last[k - 1] - first[k - 1]) + pause, first[k]
        out[k] = base + (first[k] - zero)
    return out


def laid(spans: Sequence[Span]) -> Laid:
    """Runs of one or several logs in order, with the rests between them where their clocks tell.

    By their clocks where no two overlap. Where some do, logs stay whole and are ordered by their begins: only the rest
    between two runs that overlap is not known. Logs whose clocks cannot be compared, as each starts anew or as some
    count from an epoch and some do not, stay in the order given, without rests between them. Rests within a log stay.
    """
    logs = [[k for k, s in enumerate(spans) if s.log == log] for log in dict.fromkeys(s.log for s in spans)]
    whole = [_around([spans[k] for k in log]) for log in logs]
    by_clock = sorted(range(len(spans)), key=lambda k: spans[k].begin)
    if len({s.absolute for s in spans}) > 1:
        return _told(spans, [k for log in logs for k in _in_log(spans, log)], False, _mixed(spans))
    if not any(_overlaps(spans[a], spans[b]) for a, b in pairwise(by_clock)):
        moved = Finding("info", "clock", spans[by_clock[0]].name, MOVED)
        return _told(spans, by_clock, True, *([moved] if by_clock != [*range(len(spans))] else ()))
    if not spans[0].absolute and max(s.begin for s in whole) < min(s.end for s in whole):
        anew = Finding("info", "clock", f"{len(spans)} episodes", ANEW)
        return _told(spans, [k for log in logs for k in _in_log(spans, log)], False, anew)
    by_begin = sorted(range(len(logs)), key=lambda n: whole[n].begin)
    over = [(whole[a], whole[b]) for a, b in pairwise(by_begin) if _overlaps(whole[a], whole[b])]
    order = [k for n in by_begin for k in _in_log(spans, logs[n])]
    return _told(spans, order, True, *_overlapping(over))


def _overlaps(one: Span, other: Span) -> bool:
    """Whether a run begins before the one in front of it has ended."""
    return other.begin < one.end - TOLERANCE


def _around(spans: Sequence[Span]) -> Span:
    """All that a log holds, as one span."""
    return replace(spans[0], begin=min(s.begin for s in spans), end=max(s.end for s in spans))


def _in_log(spans: Sequence[Span], log: Sequence[int]) -> list[int]:
    """The runs of one log by its clock; as they come where that starts anew within the log."""
    by_clock = sorted(log, key=lambda k: spans[k].begin)
    anew = any(_overlaps(spans[a], spans[b]) for a, b in pairwise(by_clock))
    return [*log] if anew else by_clock


def _mixed(spans: Sequence[Span]) -> Finding:
    own, epoch = (next(s for s in spans if s.absolute == kind) for kind in (False, True))
    text = (
        f"its clock begins at {own.begin:.6g} s, that of {epoch.name} at {epoch.begin:.12g} s: the two count from "
        "different times. The logs follow each other in the order given, and the rests between them are not known"
    )
    return Finding("warning", "clock", own.name, text)


def _overlapping(over: Sequence[tuple[Span, Span]]) -> Iterator[Finding]:
    """One finding for each pair, as long as these are few; else one that names the first."""
    for one, other in over if len(over) <= TOLD else over[:1]:
        like = "" if len(over) <= TOLD else f", and so do {len(over) - 1} more pairs of logs"
        text = (
            f"they overlap by {min(one.end, other.end) - other.begin:.4g} s{like}: the rest between two such logs is "
            "not known, and the second follows the first"
        )
        yield Finding("warning", "clock", f"{one.name} and {other.name}", text)


def _told(spans: Sequence[Span], order: Sequence[int], comparable: bool, *findings: Finding) -> Laid:
    """The runs in this order, each on the clock of the one before it where the rest between the two is known."""
    zero, out, rests = spans[order[0]].begin, [0.0], []
    for a, b in pairwise(order):
        one, other = spans[a], spans[b]
        if (one.log != other.log and not comparable) or _overlaps(one, other):
            zero = other.begin
        elif one.log != other.log:
            rests.append((other.begin - one.end, other.name))
        out.append(other.begin - zero)
    return Laid(tuple(order), tuple(out), (*findings, *_rests(rests)))


def _rests(rests: Sequence[tuple[float, str]]) -> Iterator[Finding]:
    """What is said of the rests between logs, each with the name of the run that follows it."""
    if rests:
        some = ", ".join(f"{max(rest, 0.0):.4g} s before {name}" for rest, name in rests[:TOLD])
        more = f" and {len(rests) - TOLD} more" if len(rests) > TOLD else ""
        yield Finding("info", "clock", "between the logs", f"the rests between the logs stay: {some}{more}")
