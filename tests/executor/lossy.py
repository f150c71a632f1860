"""An executor that shuffles and loses: each job in a process of its own, and one of these killed in the middle."""

import importlib
import multiprocessing as mp
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

from dynreg.executor.executor import Answer, Job, answer, result
from dynreg.rng import stream

PROCESSES = mp.get_context("fork")  # so that nothing is loaded and compiled anew; jobs run on one thread


@dataclass
class Lossy:
    """Jobs in an order of its own, results in theirs; see `dynreg.executor.Executor`.

    dies : {number of a job: function ("module:Class.name")}; the job is killed where that has been called, once.
    done : numbers of the jobs, in the order in which they were begun.
    """

    dies: dict[int, str] = field(default_factory=dict)
    threads: int = 1
    workers: int = 2
    done: list[int] = field(default_factory=list)

    def map(self, function: Callable[..., Any], jobs: Iterable[Job]) -> Iterator[Any]:
        """All jobs are done before the first result is given, those whose worker was lost a second time."""
        every = list(jobs)
        order = stream(0, "shuffled").permutation(len(every)).tolist()
        found = {number: self._once(function, every[number], number) for number in order}
        for number in range(len(every)):
            yield result(found[number])

    def _once(self, function: Callable[..., Any], job: Job, number: int) -> Answer:
        dies = None if number in self.done else self.dies.get(number)
        self.done.append(number)
        ours, theirs = PROCESSES.Pipe(duplex=False)
        worker = PROCESSES.Process(target=_work, args=(theirs, function, dict(job), dies))
        worker.start()
        theirs.close()
        try:
            return ours.recv()
        except EOFError:  # lost
            return self._once(function, job, number)
        finally:
            worker.join()


def _work(tell: Connection, function: Callable[..., Any], job: dict[str, Any], dies: str | None) -> None:
    if dies:
        die_after(dies)
    tell.send(answer(function, job))


def die_after(name: str) -> None:
    """Have this process killed where it has called a function."""
    module, _, place = name.partition(":")
    owner, _, attribute = place.rpartition(".")
    home = importlib.import_module(module)
    home = getattr(home, owner) if owner else home
    usual = getattr(home, attribute)

    def killed(*given: Any, **named: Any) -> None:
        usual(*given, **named)
        os.kill(os.getpid(), signal.SIGKILL)

    setattr(home, attribute, killed)
