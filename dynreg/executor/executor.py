"""What hands out independent work, and the one that keeps it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import dynreg.errors as errors
from dynreg.errors import DynregError

Done = TypeVar("Done")
Job = Mapping[str, Any]  # a function's arguments by name: numbers, texts, bytes, arrays, and lists of these

Answer = tuple[str, Any]  # what a worker sends: what came of a job, or an error of ours, as plain data
_DONE, _ERROR = "done", "error"


class Executor(Protocol):
    """Does jobs that do not depend on each other.

    threads : of one job; 0 for all cores. workers : jobs that are under way at once.
    """

    @property
    def threads(self) -> int: ...

    @property
    def workers(self) -> int: ...

    def map(self, function: Callable[..., Done], jobs: Iterable[Job]) -> Iterator[Done]:
        """`function(**job)` of every job, in the order of the jobs.

        function : a module-level name; what it answers is plain data, as a job is. It may be called again for a job
        whose worker was lost: a job that is done twice must do no more than one that is done once.
        Raises what the function raises, at the place of its job. An error of `dynreg.errors` is not tried again.
        """
        ...


@dataclass(frozen=True)
class Local:
    """Does each job in this process when its result is asked for."""

    threads: int = 0
    workers: int = 1

    def map(self, function: Callable[..., Done], jobs: Iterable[Job]) -> Iterator[Done]:
        """See `Executor.map`."""
        return (function(**job) for job in jobs)


def answer(function: Callable[..., Any], job: Job) -> Answer:
    """What comes of a job, where a worker does it. An error of ours becomes data: its message is not all of it."""
    try:
        return _DONE, function(**job)
    except DynregError as error:
        kind = next(c.__name__ for c in type(error).__mro__ if c.__module__ == errors.__name__)
        return _ERROR, (kind, vars(error))


def result(answer: Answer) -> Any:
    """What a worker's answer tells; raises the error that it tells."""
    kind, told = answer
    if kind == _ERROR:
        name, says = told
        raise getattr(errors, name)(**says)
    return told
