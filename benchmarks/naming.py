"""What the naming benchmarks share: trials in other processes, and their tables."""

import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from dynreg.diagnose.settings import TrialSettings
from dynreg.diagnose.trial import one_trial
from dynreg.diagnose.truth import Protocol
from dynreg.results import TrialTable
from dynreg.results.trials import TrialResult
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot

RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Job:
    """One trial of a robot under a plan: what it hides (None: nothing), how large, its seed, the threshold [nats]."""

    robot: Robot
    plan: Protocol
    key: str | None
    size: str | None
    seed: int
    needed: float


def run(job: Job) -> tuple[TrialResult, float]:
    """The trial, and the seconds of one core that it took, the simulation of the truth included."""
    began = time.process_time()
    hidden = () if job.key is None else (term(job.key),)
    settings = TrialSettings(threads=1)
    result = one_trial(job.robot, job.plan, hidden, job.size, job.seed, job.needed, settings, share=False)
    return result, time.process_time() - began


def run_all(jobs: Sequence[Job], processes: int) -> list[tuple[TrialResult, float]]:
    """All trials, each printed once it is done; with one process in this one."""
    if processes == 1:
        return [_told(job, run(job)) for job in jobs]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        return [_told(job, done) for job, done in zip(jobs, pool.map(run, jobs), strict=True)]


def report(name: str, done: Sequence[tuple[TrialResult, float]], needed: float) -> dict:
    """Print the table of these trials; the same as a document."""
    table = TrialTable.of(name, [r for r, _ in done], [f"threshold {needed:.3g} nats"])
    print(table)
    rates = {f"right, {size}": rate for size, rate in table.by_size.items()}
    rates |= {key.replace("_", " "): getattr(table, key) for key in ("right", "joint_right", "false_alarm")}
    for label, rate in rates.items():
        if rate is not None:
            print(f"  {label}: {rate.value:.3f} [{rate.low:.3f}, {rate.high:.3f}] of {rate.of}")
    for c in table.confusions:
        print(f"  {c.hidden} -> {c.named}: {c.count}")
    seconds = sorted(cpu for _, cpu in done)
    print(f"  one core: median {seconds[len(seconds) // 2]:.1f} s, most {seconds[-1]:.1f} s", flush=True)
    return table.to_dict() | {"threshold": needed, "core_seconds": [cpu for _, cpu in done]}


def write(name: str, document: dict) -> None:
    """Keep a document under benchmarks/results/."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / name).write_text(json.dumps(document, indent=1) + "\n")


def _told(job: Job, done: tuple[TrialResult, float]) -> tuple[TrialResult, float]:
    result, seconds = done
    good = "right" if result.right else "WRONG"
    hides = f"{job.key} {job.size}" if job.key else "nothing"
    print(f"    {good}: {hides} -> {result.named} ({result.verdict}), {seconds:.0f} s", flush=True)
    return done
