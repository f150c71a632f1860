"""Functions for the jobs of executors under test."""

import os
import signal
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from lossy import die_after

from dynreg.errors import BudgetError, UsageError
from dynreg.verbs.populations import fill_span


def doubled(values: np.ndarray, name: str) -> tuple[str, np.ndarray]:
    """Plain data in, plain data out."""
    return name, 2 * values


def refused(kind: str, counter: str) -> NoReturn:
    """An error of ours, and a mark for each time that it was tried."""
    with Path(counter).open("a") as file:
        file.write(".")
    if kind == "budget":
        raise BudgetError("no trial is left", expected="one", do="stop", what="trials")
    raise UsageError("k = 0", expected="1 or more", do="ask for one", setting="k")


def broken(counter: str) -> NoReturn:
    """A bug."""
    raise ZeroDivisionError(counter)


def once_lost(number: int, folder: str) -> int:
    """The process of job 1 is killed the first time."""
    mark = Path(folder) / "lost"
    if number == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def lost(number: int) -> NoReturn:
    """A job that kills whoever does it."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError(number)


def span_killed_once(span: tuple[int, int], mark: str, dies: str, **job: Any) -> tuple[int, dict[str, float]]:
    """`fill_span`, whose process is killed the first time after it has called `dies`."""
    if not Path(mark).exists():
        Path(mark).touch()
        die_after(dies)
    return fill_span(span=span, **job)
