"""The jobs of the tables of gaits: a robot with what is left of it, and the journal that its lines go to."""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

from journal import Journal

from dynreg.diagnose.threshold import USUAL
from dynreg.rng import stream_seed

K = 5  # simulators, of ways that have several
PULLED = 0.3  # of the way from the answer to a neighbour, where `pulled` has it: our own choice
TRIALS = 3  # of a gait on the robot, and of `rounds`
ORACLES = 5


@dataclass(frozen=True)
class Plan:
    """What makes it this table."""

    seed: int
    robots: int
    rollouts: int
    entries: int
    nulls: int = 0
    effects: tuple[str, ...] = ()
    packaged: bool = False
    trials: int = TRIALS
    oracles: int = ORACLES
    pulled: float = PULLED


@dataclass(frozen=True)
class Job:
    """One robot with the sources that are left, and where its lines go. needed : nats that a cause needs."""

    plan: Plan
    name: str
    sources: tuple[str, ...]
    journal: Path
    registry: str
    population: str
    needed: float = USUAL


class Cells(Journal):
    """The journal of such a table: a line for each finished step of each robot."""

    def __init__(self, path: Path, plan: Plan):
        super().__init__(path, {"plan": asdict(plan)})

    def keep(self, robot: str, step: str, found: dict) -> dict:
        """Keep what a step found; on disk, as one line, when this returns."""
        return self.add({"robot": robot, "step": step, **found})

    def steps(self) -> dict[tuple[str, str], dict]:
        """{(robot, step): what it found} of all that is done."""
        return {(line["robot"], line["step"]): line for line in self.lines()}

    def timed(self, robot: str, step: str, made: Callable[[], dict]) -> dict:
        """Make a step and keep what it found, with its seconds of a core."""
        began = time.process_time()
        found = made()
        return self.keep(robot, step, {**found, "core": time.process_time() - began})


def search_seed(seed: int, number: int = 0) -> int:
    """The seed of a robot's search of this number, from 0."""
    return stream_seed(seed, "search", *([number] if number else [])) % 2**31


def run(step: Callable[[Job], str], jobs: list[Job], processes: int) -> None:
    """Do all jobs, and print the name of each when it is done."""
    began = time.perf_counter()
    told = lambda name: print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)  # noqa: E731
    if processes == 1:
        for job in jobs:
            told(step(job))
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(step, job) for job in jobs]):
            told(future.result())
