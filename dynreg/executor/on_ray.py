"""Jobs on workers of Ray: those of a cluster, or processes of this machine.

Ray places the tasks, and does those of a lost worker again (its own `max_retries`). Only names, plain data and a
function of a few lines travel; what a worker stores it puts into the registry itself.
"""

import os
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from dynreg.errors import ExecutorError, UsageError
from dynreg.executor.executor import Answer, Done, Executor, Job, result

ADDRESS = "RAY_ADDRESS"
OWN, ANY = "local", "auto"  # Ray's words for an instance of one's own, and for one that runs on this machine
ANSWERS = 5.0  # seconds within which a cluster's address must answer; Ray itself waits for five minutes


@dataclass(frozen=True, eq=False)
class _Ray:
    """Jobs as tasks of `ray`, the module, which is connected. threads : cores of each task."""

    ray: Any
    threads: int

    @property
    def workers(self) -> int:
        """Tasks that the cluster's cores bear now."""
        return max(int(self.ray.cluster_resources().get("CPU", 1)) // self.threads, 1)

    def map(self, function: Callable[..., Done], jobs: Iterable[Job]) -> Iterator[Done]:
        """See `Executor.map`. Raises ExecutorError where a job loses its worker each time, or its dynreg differs."""
        task = self.ray.remote(num_cpus=self.threads)(_task())
        name = f"{function.__module__}:{function.__qualname__}"
        waiting = deque(task.remote(_version(), name, dict(job)) for job in jobs)
        # Whose answers nobody asks for, after an error, Ray ends when it is left. `ray.cancel` would do so before, and
        # takes this process down where a task is just then done (2.60: "an unexpected system state").
        while waiting:
            yield self._answer(waiting.popleft())

    def _answer(self, task: Any) -> Any:
        broken = self.ray.exceptions
        try:
            version, answer = self.ray.get(task)
        except broken.RayTaskError as error:  # no error of ours: a bug, or what the machine refuses
            raise error.cause from None
        except broken.RayError as error:
            raise ExecutorError(
                f"Ray lost the worker of a job each time that it tried: {type(error).__name__}",
                expected="workers that live as long as a job takes",
                do="look for the reason in Ray's logs (memory?), then run the same command: what is stored stays",
            ) from error
        if version != _version():
            raise _differs(version)
        return result(answer)


def _task() -> Callable[[str, str, Job], tuple[str | None, Answer | None]]:
    """What Ray sends: by value, so that a worker without dynreg can say so.

    It gives the version that the worker has, None where it has none, and the answer where that is the right one.
    """

    def run(version: str, name: str, job: Job) -> tuple[str | None, Answer | None]:
        import os
        from importlib import import_module

        os.environ.setdefault("MUJOCO_GL", "disable")  # as the command has it: no job draws
        try:
            there, worker = import_module("dynreg").__version__, import_module("dynreg.executor.executor")
        except ImportError:
            return None, None
        if there != version:
            return there, None
        module, _, function = name.partition(":")
        return there, worker.answer(getattr(import_module(module), function), job)

    return run


@contextmanager
def connected(address: str | None, threads: int) -> Iterator[Executor]:
    """Ray at this address, else at RAY_ADDRESS, else started on this machine; a connection that is there stays.

    Raises UsageError where ray is not installed, ExecutorError where no cluster answers.
    """
    ray = _imported()
    if ray.is_initialized():
        yield _on(ray, threads)
        return
    where = address or os.environ.get(ADDRESS) or OWN
    _require_answer(where)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # this machine tells nobody what it does
    own = {"include_dashboard": False} if where == OWN else {}
    with redirect_stdout(sys.stderr):  # Ray tells there of lost workers, where a command's document belongs
        try:
            ray.init(address=where, log_to_driver=False, logging_level="ERROR", **own)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise _no_cluster(where, error) from error
        try:
            yield _on(ray, threads)
        finally:
            ray.shutdown()


def _on(ray: Any, threads: int) -> _Ray:
    """ExecutorError where no machine of the cluster has as many cores as a job takes: it would wait for ever."""
    cores = max((int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]), default=0)
    if 0 < cores < threads:
        raise ExecutorError(
            f"jobs of {threads} threads on a cluster whose machines have {cores} cores",
            expected=f"1 to {cores} threads",
            do=f"add --threads {cores}, or leave --threads out for one",
        )
    return _Ray(ray, threads or 1)


def _imported() -> Any:
    try:
        import ray
    except ImportError:
        raise UsageError(
            "--executor ray needs the package ray, which is not installed",
            expected="the optional part `ray` of dynreg",
            do="run `pip install 'dynreg[ray]'`, or leave --executor out",
        ) from None
    return ray


def _require_answer(where: str) -> None:
    """ExecutorError where nobody listens at a cluster's address."""
    if where in (OWN, ANY):
        return
    try:
        parts = urlsplit(where if "://" in where else f"//{where}")
        if not parts.hostname or parts.port is None:
            raise ValueError("it names no host and port")
        socket.create_connection((parts.hostname, parts.port), timeout=ANSWERS).close()
    except (OSError, ValueError) as error:
        raise _no_cluster(where, error) from error


def _no_cluster(where: str, error: Exception) -> ExecutorError:
    return ExecutorError(
        f"no Ray cluster at {where!r}: {error}",
        expected="HOST:PORT of a running one, as `ray start --head` tells it",
        do=f"correct --address or {ADDRESS}, or leave both out for workers on this machine",
    )


def _version() -> str:
    return import_module("dynreg").__version__  # by name, as a worker finds it


def _differs(there: str | None) -> ExecutorError:
    what = "no dynreg" if there is None else f"dynreg {there}"
    return ExecutorError(
        f"a worker of the cluster has {what}",
        expected=f"dynreg {_version()}, as here: the same entries come from the same code",
        do=f"run `pip install dynreg=={_version()}` on its machines",
    )
