"""What goes to stdout (one result) and to stderr (progress, errors)."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from dynreg.foreign import visible
from dynreg.verbs.verb import Progress

WIDTH = 100


def say(line: str) -> None:
    """A line on stderr, whatever foreign text is in it."""
    print(visible(line), file=sys.stderr, flush=True)


def console(stream=None):
    """A rich console on `stream` (stdout): at most 100 columns wide, without colours unless on a terminal."""
    from rich.console import Console

    stream = stream or sys.stdout
    wanted = Console(file=stream)
    width = min(WIDTH, wanted.width) if wanted.is_terminal else WIDTH
    return Console(file=stream, width=width, markup=False, emoji=False, highlight=False)


@contextmanager
def progress_bars(wanted: bool) -> Iterator[Progress | None]:
    """A function (stage, done, total) that draws bars on stderr; None where nobody would see them."""
    if not wanted or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console(sys.stderr), transient=True) as bars:
        tasks = {}

        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield advance
