"""What hands out independent work, and the one that keeps it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

Done = TypeVar("Done")
Job = Mapping[str, Any]  # a function's arguments by name: numbers, texts, bytes, arrays, and lists of these


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
