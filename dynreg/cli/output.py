"""What goes to stdout (one result) and to stderr (progress, errors)."""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from dynreg.foreign import visible
from dynreg.progress import Progress

WIDTH = 100
PATIENCE = (
    1.5  # seconds that a command may take before it says what it does: with its own start, 2 for who waits
)
TICK = 0.25  # seconds between two looks at whether something is to be told
LONG, SURE = (
    180.0,
    10.0,
)  # seconds: a time left about which advice is worth a line, and after which it can be told
FINE = 1000  # steps in all, from which on tenths of a per cent are told: the first per cent may take minutes
EVERY = 10.0  # seconds between two lines about one stage


def say(line: str) -> None:
    """A line on stderr, whatever foreign text is in it."""
    print(visible(line), file=sys.stderr, flush=True)


class PlainProgress:
    """Progress as lines on stderr: one when a stage begins, then at most one every `EVERY` seconds.

    Commands that are done within `PATIENCE` seconds say nothing. faster : what makes a command faster, told once where
    it will take longer than `LONG`.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, faster: str = ""):
        self._clock, self._began, self._told_at = clock, clock(), -math.inf
        self._stages: dict[str, tuple[float, int]] = {}  # when each began, and how much was done then
        self._steps: dict[str, tuple[float, int]] = {}  # when each went on last, and how much was done then
        self._told: set[str] = set()
        self._faster, self._last, self._lock = faster, None, threading.Lock()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """`done` of `total` of a stage are done."""
        with self._lock:
            self._last = None if done >= total else (stage, done, total)
            self._report(stage, done, total)

    def again(self) -> None:
        """Time goes on: what is under way is told where it was not, or not for `EVERY` seconds."""
        with self._lock:
            if self._last is not None:
                self._report(*self._last)

    def _report(self, stage: str, done: int, total: int) -> None:
        now = self._clock()
        since, first = self._stages.setdefault(stage, (now, done))
        if done >= total:  # a stage of this name may begin again
            del self._stages[stage]
            self._steps.pop(stage, None)
            return
        if now - self._began < PATIENCE:
            return
        at, before = self._steps.get(stage, (now, done))
        at = at if done == before else now
        self._steps[stage] = (at, done)
        left = (at - since) * (total - done) / (done - first) - (now - at) if done > first else None
        if self._faster and left is not None and left > LONG and now - since > SURE:
            say(f"{stage}: this takes about {_duration(left)}; {self._faster}")
            self._faster = ""
        if stage in self._told and now - self._told_at < EVERY:
            return
        self._told.add(stage)
        self._told_at = now
        if left is not None and left < 0:  # the step under way takes longer than those before it promised
            say(f"{stage}: still at it, {_duration(now - since)} so far")
        elif done == 0:  # nobody knows how much is done of the first step
            say(f"{stage} ..." if now - since < EVERY else f"{stage}: {_duration(now - since)} so far")
        else:
            share = (
                f"{math.floor(1000 * done / total) / 10:.1f}" if total >= FINE else f"{100 * done // total}"
            )
            say(f"{stage}: {share} %" + (f", about {_duration(left)} left" if left is not None else ""))


@contextmanager
def _ticking(lines: PlainProgress) -> Iterator[PlainProgress]:
    """Lines that also come while nothing is reported, as during a step that takes long."""
    over = threading.Event()

    def tick() -> None:
        while not over.wait(TICK):
            lines.again()

    beside = threading.Thread(target=tick, daemon=True)
    beside.start()
    try:
        yield lines
    finally:
        over.set()
        beside.join()


def _duration(seconds: float) -> str:
    """A time as people say it.

    >>> _duration(42), _duration(200), _duration(9000)
    ('42 s', '3 min', '2.5 h')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def console(stream=None):
    """A rich console on `stream` (stdout): at most 100 columns wide, without colours unless on a terminal."""
    from rich.console import Console

    stream = stream or sys.stdout
    wanted = Console(file=stream)
    width = min(WIDTH, wanted.width) if wanted.is_terminal else WIDTH
    return Console(file=stream, width=width, markup=False, emoji=False, highlight=False)


@contextmanager
def progress_bars(wanted: bool, faster: str = "") -> Iterator[Progress | None]:
    """A function (stage, done, total) that draws bars on stderr, plain lines where it is no terminal; or None.

    faster : as for `PlainProgress`.
    """
    if not wanted:
        yield None
        return
    if not sys.stderr.isatty():
        with _ticking(PlainProgress(faster=faster)) as lines:
            yield lines
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    # steps may take minutes: the speed is that of the last five
    with Progress(*columns, console=console(sys.stderr), transient=True, speed_estimate_period=300.0) as bars:
        tasks, advice = {}, [faster] if faster else []

        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(visible(stage), total=total)
            bars.update(tasks[stage], completed=done, total=total)
            task = bars.tasks[tasks[stage]]
            if advice and (task.elapsed or 0.0) > SURE and (task.time_remaining or 0.0) > LONG:
                bars.print(f"{stage}: this takes about {_duration(task.time_remaining)}; {advice.pop()}")

        yield advance
