"""What the naming benchmarks share: their arguments, seeds and threshold, trials in other processes, and tables."""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import numpy as np
from journal import Journal
from kept import RESULTS

from dynreg.diagnose.threshold import SEARCH, USUAL, Threshold
from dynreg.diagnose.trial import Trial, Trials
from dynreg.diagnose.trial import nulls as simulated
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.truth import Protocol
from dynreg.results.trials import Rate, TrialResult, TrialTable, confident, rate
from dynreg.rng import stream_seed
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import Robot
from dynreg.verbs.trials import results_of

TUNE = 3  # the seed of the development, of the commands and of the threshold
PARTS = 10  # in which the threshold's robots are simulated
MANY = 100  # trials: with more, a line tells of fifty
NOTHING = "nothing"  # hidden or named
TRUTHS = ("own", "independent")  # code of the hidden robots: the library's, or other
RATES = (
    "right",
    "in_part",
    "joint_right",
    "covered",
    "wrong",
    "false_alarm",
    "not_none",
    "outside",
    "in_set",
)
KEPT = (
    *RATES,
    "by_size",
    "confusions",
    "set_median",
    "set_p95",
    "gain_share_median",
    "parameter_error_median",
)


@dataclass(frozen=True)
class Job:
    """One trial of a robot under a plan.

    keys : what it hides, () for nothing; of a robot whose `truth` is independent one cause of `dynreg.truths`; size :
    how large; seed : of the robot; needed : the threshold; without : effects that the diagnosis lacks; max_causes :
    where it stops; share, interval : as in `results_of`.
    """

    robot: Robot
    plan: Protocol
    keys: tuple[str, ...]
    size: str | None
    seed: int
    needed: Threshold
    without: tuple[str, ...] = ()
    max_causes: int = 1
    share: bool = False
    interval: bool = False
    truth: str = "own"


def arguments(about: str, **defaults: int | bool) -> argparse.ArgumentParser:
    """What every naming benchmark can be asked; `defaults` name those of the benchmark."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--none", type=int, help="robots without an effect")
    parser.add_argument("--threshold-runs", type=int, help="robots from which the threshold is found")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--truth", choices=TRUTHS, default="own", help="code that simulates the hidden robots"
    )
    yes_no = argparse.BooleanOptionalAction
    parser.add_argument(
        "--interval", action=yes_no, default=False, help="whether 90 %% intervals hold the truth"
    )
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    parser.add_argument("--write", action=yes_no, default=True, help="keep the tables in benchmarks/results/")
    parser.add_argument(
        "--journal", type=Path, help="file of the trials that are done: a second start goes on"
    )
    parser.set_defaults(**defaults)
    return parser


def seeds(seed: int, *names: object, n: int) -> list[int]:
    """Of n robots under these names."""
    return [stream_seed(seed, *names, i) % 2**31 for i in range(n)]


def threshold(
    name: str, robot: Robot, plan: Protocol, given: argparse.Namespace, journal: Journal | None = None
) -> Threshold:
    """What a cause needs, from robots without any; printed. One that the journal has is not sought again."""
    began = time.perf_counter()
    lines = [line for line in journal.lines() if line.get("threshold") == name] if journal else []
    if given.threshold_runs == 0:
        needed = Threshold(USUAL, ())
    elif lines and lines[-1]["runs"] == given.threshold_runs:
        needed = Threshold.of(lines[-1]["nulls"])
    else:
        parts = min(PARTS, given.threshold_runs)
        chunks = [(robot, plan, range(i, given.threshold_runs, parts)) for i in range(parts)]
        with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
            made = [one for part in pool.map(nulls, chunks) for one in part]
        needed = Threshold.of(made)
        if journal:
            journal.add({"threshold": name, "runs": given.threshold_runs, "nulls": made})
        largest = [[round(one, 1) for one in sorted(column)[::-1][:10]] for column in zip(*made, strict=True)]
        print(f"without an effect: largest scores {largest[0]}, residuals over stated noise {largest[1]}")
    seconds = time.perf_counter() - began
    print(
        f"{name}: threshold {needed.nats:.1f} nats from {given.threshold_runs} robots, {seconds:.0f} s",
        flush=True,
    )
    return needed


def nulls(given: tuple[Robot, Protocol, range]) -> list[tuple[float, float]]:
    """Scores [nats] and residuals of robots without an effect, by their numbers."""
    robot, plan, numbers = given
    return simulated(Trials(robot, plan, seed=TUNE, threads=1), numbers)


def run(job: Job) -> TrialResult:
    """The trial, on one core; alone, so that its seconds are its own."""
    limits = job.size, job.seed, job.without, job.max_causes
    if job.truth == "own":
        trial = Trial(tuple(term(key) for key in job.keys), *limits)
    else:
        trial = Trial((), *limits, cause=job.keys[0] if job.keys else None)
    trials = Trials(job.robot, job.plan, threads=1, truth=job.truth)
    asked = {"share": job.share, "interval": job.interval}
    (result,) = results_of(trials, [trial], job.needed, **asked)
    return result


def run_all(jobs: Sequence[Job], processes: int, journal: Journal | None = None) -> list[TrialResult]:
    """All trials in their order, told as they are done; with one process in this one, one after the other.

    Those in the journal are not run again; every new one is in it as soon as it is done.
    """
    lines = journal.lines() if journal else []
    known = {line["trial"]: line["result"] for line in lines if "trial" in line}
    before = {i: known[_key(job)] for i, job in enumerate(jobs) if _key(job) in known}
    done = {i: TrialResult.model_validate(result) for i, result in before.items()}
    _tell(jobs, done)
    for i, result in _finished(jobs, [i for i in range(len(jobs)) if i not in before], processes):
        done[i] = result
        if journal:
            journal.add({"trial": _key(jobs[i]), "result": result.to_dict()})
        _tell(jobs, done)
    return [done[i] for i in range(len(jobs))]


def _finished(jobs: Sequence[Job], left: Sequence[int], processes: int) -> Iterator[tuple[int, TrialResult]]:
    """(number, result) of the jobs that are left, as they are done."""
    if processes == 1:
        yield from ((i, run(jobs[i])) for i in left)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(run, jobs[i]): i for i in left}
        for future in as_completed(waiting):
            yield waiting[future], future.result()


def _key(job: Job) -> str:
    """What tells a trial from all others of the table; robots of other code say so."""
    of_it = job.without, job.max_causes, job.share, job.interval
    said = (job.keys, job.size, job.seed, job.needed.nats, *of_it)
    return json.dumps(said if job.truth == "own" else (*said, job.truth))


def journal_of(given: argparse.Namespace, robot: Robot, seed: int) -> Journal | None:
    """The journal that was asked for, begun; SystemExit where it is that of another robot or other seeds."""
    if given.journal is None:
        return None
    journal = Journal(given.journal, {"robot": robot.hash, "seed": seed, "search": SEARCH})
    journal.begin()
    return journal


def document(name: str, done: Sequence[TrialResult], needed: Threshold) -> dict:
    """The tables of these trials: rates, effects by size, who was taken for whom, sizes of sets, seconds."""
    table = TrialTable.of(name, done).to_dict()
    effects = dict.fromkeys(r.hidden for r in done if r.hidden)
    return {
        "robot": name,
        **{key: table[key] for key in KEPT},
        "effects": {e: _effect([r for r in done if r.hidden == e]) for e in effects},
        "matrix": {
            e or NOTHING: _names(r for r in done if r.hidden == e)
            for e in dict.fromkeys(r.hidden for r in done)
        },
        "threshold": needed.nats,
        "seconds": {
            "wall": _spread([r.seconds for r in done]),
            "core": _spread([r.core_seconds for r in done if r.core_seconds is not None]),
        },
    }


def report(name: str, done: Sequence[TrialResult], needed: Threshold) -> dict:
    """Print the tables of these trials; the same as a document."""
    table, out = TrialTable.of(name, done), document(name, done, needed)
    print(table)
    _print_effects(out)
    for size, share in table.by_size.items():
        print(f"  right, {size}: {interval(share)}")
    for key in RATES:
        share = getattr(table, key)
        if share is not None:
            print(f"  {key.replace('_', ' ')}: {interval(share)}")
    print(
        f"  sets: median {table.set_median}, 95 % {table.set_p95}; share of the attainable gain, median "
        f"{table.gain_share_median}; error of the size, median {table.parameter_error_median}"
    )
    for c in table.confusions:
        print(f"  {c.hidden} -> {c.named}: {c.count}")
    for clock, spread in out["seconds"].items():
        if spread:
            print(f"  {clock} seconds: median {spread['median']:.1f}, 95 % {spread['p95']:.1f}", flush=True)
    return out


def report_absent(done: Sequence[TrialResult]) -> dict | None:
    """Print which names were given with confidence though the cause was taken away; the same as a document."""
    wrong = [f"{r.hidden} -> {r.named}" for r in done if confident(r.verdict)]
    if not done:
        return None
    print(f"  cause absent: confident wrong names {len(wrong)} of {len(done)}", *wrong, sep="\n    ")
    return {"wrong": len(wrong), "of": len(done), "names": wrong}


def report_pairs(done: Sequence[TrialResult]) -> dict | None:
    """Print how often both of two causes were named, and what was said where not; the same as a document."""
    both = rate(r.right for r in done)
    if both is None:
        return None
    missed = [
        f"{r.hidden} ({r.size}) -> {r.verdict}, {', '.join(r.causes) or 'no cause'}"
        for r in done
        if not r.right
    ]
    print(f"  two causes at once, both named: {interval(both)}", *missed, sep="\n    ")
    return both.to_dict() | {"missed": missed}


def interval(share: Rate) -> str:
    """A rate with its 90 % interval."""
    return f"{share.value:.3f} [{share.low:.3f}, {share.high:.3f}] of {share.of}"


def titled(robot: str, truth: str) -> str:
    """What the tables of a robot are called."""
    return robot if truth == "own" else f"{robot}, independent truth"


def write(name: str, out: dict, given: argparse.Namespace) -> None:
    """Keep a document under benchmarks/results/, but for robots of the development."""
    if given.write and not given.tune:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / name).write_text(json.dumps(out, indent=1) + "\n")


def _tell(jobs: Sequence[Job], done: dict[int, TrialResult]) -> None:
    """Of few trials a line for the latest, of many one for every fifty that says how well it goes."""
    if not done:
        return
    if len(jobs) > MANY:
        if len(done) % 50 == 0:
            said = [_judged(jobs[i], result) for i, result in done.items()]
            right, wrong = said.count("right"), said.count("WRONG")
            print(f"{len(done)} of {len(jobs)} done: right {right}, wrong {wrong}", flush=True)
        return
    latest, result = next(reversed(done.items()))
    job = jobs[latest]
    hides = f"{'+'.join(job.keys)} {job.size}" if job.keys else NOTHING
    hides += ", taken away" if job.without else ""
    said = f"{result.named} ({result.verdict}), {result.seconds:.0f} s"
    print(f"    {_judged(job, result)}: {hides} -> {said}", flush=True)


def _judged(job: Job, result: TrialResult) -> str:
    """Whether a trial was right; a cause that was taken away is rightly missed."""
    if job.without:
        return "WRONG" if confident(result.verdict) else "right"
    return "right" if result.right else "part" if result.in_part else "WRONG" if result.wrong else "missed"


def _effect(mine: Sequence[TrialResult]) -> dict:
    """Of one effect: rates, [right, of] by size, and the median error of the size where the name was right."""
    errors = [r.parameter_error for r in mine if r.right and r.parameter_error is not None]
    sized = {s: [r.right for r in mine if r.size == s] for s in SIZES}
    shares = {
        "right": rate(r.right for r in mine),
        "in_set": rate(r.in_set for r in mine if r.in_set is not None),
        "covered": rate(r.covered for r in mine if r.covered is not None),
    }
    return {
        **{key: share and share.to_dict() for key, share in shares.items()},
        "sizes": {s: [sum(found), len(found)] for s, found in sized.items() if found},
        "error": median(errors) if errors else None,
    }


def _names(results: Iterable[TrialResult]) -> dict[str, int]:
    """{named: how often}, most often first; joints do not make another name."""
    return dict(Counter((r.named or NOTHING).split("[")[0] for r in results).most_common())


def _spread(seconds: Sequence[float]) -> dict[str, float] | None:
    """Median and 95th percentile, the latter one that was seen."""
    if not seconds:
        return None
    p95 = float(np.quantile(seconds, 0.95, method="inverted_cdf"))
    return {"median": median(seconds), "p95": p95}


def _print_effects(out: dict) -> None:
    """Of each effect how often it was named at each size, the error of its size, and how often intervals held it."""
    print(f"{'right of robots':24s} " + " ".join(f"{s:>8s}" for s in SIZES) + "   error  covered")
    for effect, found in out["effects"].items():
        cells = [f"{'/'.join(map(str, found['sizes'].get(s, ['-']))):>8s}" for s in SIZES]
        error = "-" if found["error"] is None else f"{found['error']:.3f}"
        held = found["covered"]
        covered = f"{held['hits']}/{held['of']} [{held['low']:.2f}, {held['high']:.2f}]" if held else "-"
        print(f"{effect:24s} {' '.join(cells)}   {error:>5s}  {covered}")


def group(robot: Robot, key: str) -> tuple[str, ...]:
    """Ids of the effect and of those of its exact group."""
    mine = term(key).effect
    every = (t.effect for t in single_terms(robot))
    return tuple(e.id for e in every if e.id == key or (mine.group and e.group == mine.group))
