"""Populate by this process and by workers of Ray: the same bytes, how long it takes, and what a killed worker costs.

    python benchmarks/bench_executor.py [--shards 10] [--size 50]

Needs `pip install 'dynreg[ray]'`. Every run fills a registry of its own with the same servos. Timed is the filling
alone: the base model is trained before, and workers have made a shard of another population, so that they have loaded
and compiled what they need (told apart, as `start`). The last run kills a worker with SIGKILL in the middle.
"""

import argparse
import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from kept import RESULTS, keep

from dynreg.distance.population import Training
from dynreg.executor import Executor, Local, opened
from dynreg.neighbours.entries import Stopwatch
from dynreg.registry import Registry, verify
from dynreg.sim.robot import load_robot
from dynreg.verbs.populations import Plan, begin, fill

ROBOT, SEED, EMPTY = "servo_pendulum", 0, 300
QUICK = Training(epochs=1, base_configurations=4, base_epochs=1)  # of the population that warms workers up


@dataclass(frozen=True)
class Filled:
    """One run. start : seconds until workers were ready; seconds : of the filling; empty : of a job that does nothing.

    core_seconds : simulation and training alone, in all workers. killed : processes that were killed. clean : whether
    the registry verifies afterwards.
    """

    how: str
    start: float
    seconds: float
    core_seconds: float
    empty: float
    killed: int
    content: str
    clean: bool


def filled(
    folder: Path, how: str, executor: Executor, start: float, plan: Plan, kill: bool = False
) -> Filled:
    """Fill a new registry by an executor whose workers are ready; `kill` one of them when half is there."""
    path, watch, killed = folder / how, Stopwatch(), []
    with Registry.open(path, create=True) as registry:
        identity = begin(registry, load_robot(ROBOT), plan, Stopwatch(), lambda *_: None)
        watching = threading.Thread(target=_kill_at_half, args=(path, identity, plan.n, killed))
        if kill:
            watching.start()
        began = time.perf_counter()
        fill(registry, identity, executor, watch, lambda _: None)
        seconds = time.perf_counter() - began
        if kill:
            watching.join()
        assert registry.count(identity) == plan.n
        content = registry.content_hash()
    report = verify(path)
    clean = not report.faults and not report.leftovers
    spent = watch.seconds["simulate"] + watch.seconds["train"]
    return Filled(how, start, seconds, spent, _empty(executor), len(killed), content, clean)


def _empty(executor: Executor) -> float:
    """Seconds that a job takes of which nothing is asked."""
    began = time.perf_counter()
    list(executor.map(dict, [{"number": i} for i in range(EMPTY)]))
    return (time.perf_counter() - began) / EMPTY


@contextmanager
def on_ray(folder: Path, workers: int) -> Iterator[tuple[Executor, float]]:
    """Ray on this machine with so many workers, each of which has made a shard; and how long that took."""
    import ray

    began = time.perf_counter()
    ray.init("local", num_cpus=workers, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    try:
        with opened("ray") as executor:
            _warm(folder / f"warm {workers}", executor)
            yield executor, time.perf_counter() - began
    finally:
        ray.shutdown()


def _warm(path: Path, executor: Executor) -> None:
    """Each worker makes a shard of another population."""
    plan = Plan(4 * executor.workers, SEED, QUICK, 4, 1)
    with Registry.open(path, create=True) as registry:
        identity = begin(registry, load_robot(ROBOT), plan, Stopwatch(), lambda *_: None)
        fill(registry, identity, executor, Stopwatch(), lambda _: None)


def _kill_at_half(path: Path, identity: str, n: int, killed: list[int]) -> None:
    with Registry.open(path) as registry:
        while registry.count(identity) < n // 2:
            time.sleep(0.05)
        while not (busy := _busy()) and registry.count(identity) < n:
            time.sleep(0.01)
    for process in busy[:1]:
        os.kill(process, signal.SIGKILL)
        killed.append(process)


def _busy() -> list[int]:
    """Workers of this process's Ray that do a job now: as Linux tells of them."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            doing = b"ray::run" == (place / "cmdline").read_bytes().partition(b"\0")[0]  # a task
            if doing and _parent(_parent(place)) == os.getpid():
                found.append(int(place.name))
        except OSError:  # it has ended
            continue
    return found


def _parent(process: Path | int) -> int:
    place = process if isinstance(process, Path) else Path("/proc") / str(process)
    return int((place / "stat").read_text().rpartition(")")[2].split()[1])


def main() -> None:
    """Print the table and write benchmarks/results/executor.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shards", type=int, default=10)
    parser.add_argument("--size", type=int, default=50)
    given = parser.parse_args()
    plan = Plan(given.shards * given.size, SEED, Training(), given.size, 0)
    runs: list[Filled] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _warm(folder / "warm", Local(1))
        for how, threads in (("local, 1 thread", 1), ("local, all cores", 0)):
            runs.append(filled(folder, how, Local(threads), 0.0, plan))
        for workers in (1, 2):
            with on_ray(folder, workers) as (executor, start):
                runs.append(
                    filled(folder, f"ray, {workers} worker{'s' * (workers > 1)}", executor, start, plan)
                )
                if workers == 2:
                    runs.append(
                        filled(folder, "ray, 2 workers, one killed", executor, start, plan, kill=True)
                    )
    print(f"{given.shards} shards of {given.size} {ROBOT}")
    print(
        f"{'':28s} {'start [s]':>10s} {'fill [s]':>9s} {'cores [s]':>10s} {'a job [ms]':>11s} killed same clean"
    )
    for run in runs:
        same = run.content == runs[0].content
        print(
            f"{run.how:28s} {run.start:10.1f} {run.seconds:9.1f} {run.core_seconds:10.1f} {1e3 * run.empty:11.2f} "
            f"{run.killed:6d} {same!s:>4s} {run.clean!s:>5s}"
        )
    one, alone = runs[2], runs[0]
    over = (one.seconds - one.core_seconds - alone.seconds + alone.core_seconds) / given.shards
    print(
        f"overhead a shard, ray with 1 worker over 1 local thread, beside simulation and training: {over:.3f} s"
    )
    told = {
        "shards": given.shards,
        "size": given.size,
        "overhead_a_shard": over,
        "runs": [asdict(r) for r in runs],
    }
    keep(RESULTS / "executor.json", told, parser, given)
    if not all(run.clean and run.content == alone.content for run in runs) or not runs[-1].killed:
        raise SystemExit("a run left other bytes or faults, or no worker was killed")


if __name__ == "__main__":
    main()
