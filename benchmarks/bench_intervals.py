"""Whether 90 % intervals of hidden sizes hold: coverage, and ranks of the true sizes among the posterior's draws.

Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari, Gelman 2018, arXiv:1804.06788): where intervals are
right, the true size is as likely at any rank among the draws as at any other, and 90 % of intervals hold it. Each robot
hides one effect, and the diagnosis is told which (only that effect is a candidate, and no threshold is asked for), so
that naming selects nothing; with `--named` it finds the name, and the right ones count. `--truth independent` simulates
the robots by other code than the library's. Beside each table: the ranks of the nominal parameters that have a
nameplate, all of which are drawn from it.

Robots of tables that are reported (`REPORT`) were never used to choose anything; `--tune` takes those of the
development.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import numpy as np
from journal import Journal
from kept import RESULTS
from naming import TRUTHS, TUNE, seeds
from scipy.stats import binomtest, kstest

from dynreg.diagnose.diagnose import search
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import planned
from dynreg.diagnose.threshold import USUAL, Threshold, known
from dynreg.diagnose.trial import Trial, Trials, hidden_log
from dynreg.evidence.estimate import estimates
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.interval import Posterior, posterior
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import Hidden, protocol
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import load_robot
from dynreg.truths.table import causes_of

FILE = RESULTS / "intervals.json"
JOURNALS = Path(__file__).parent / "registry"
REPORT = 20261220
SECONDS = {"servo_pendulum": 50.0, "two_joint_arm": 50.0, "leg": 50.0}
LEVEL = 0.9  # of the intervals: by contract


@dataclass(frozen=True)
class Job:
    """One hidden robot: what it hides at which size, its seed, and whether its diagnosis is left to find the name."""

    robot: str
    truth: str
    key: str
    size: str
    seed: int
    named: bool


def of_robot(given: argparse.Namespace) -> list[Job]:
    """The robots of a table."""
    robot, seed = load_robot(given.robot), TUNE if given.tune else given.seed
    if given.truth == "own":
        able = [t.key for t in single_terms(robot) if not t.joints]
    else:
        able = list(causes_of(given.robot, "same"))
    return [
        Job(given.robot, given.truth, key, size, one, given.named)
        for key in given.only or able
        for size in given.sizes
        for one in seeds(seed, "intervals", given.robot, given.truth, key, size, n=given.robots)
    ]


def fitted(job: Job) -> tuple[Hidden, State, float]:
    """What a robot hides, the end of the search for it, and its core seconds."""
    robot = load_robot(job.robot)
    plan = protocol(robot, seed=TUNE, seconds=SECONDS[job.robot])
    trials = Trials(robot, plan, threads=1, truth=job.truth)
    if job.truth == "own":
        trial = Trial((term(job.key),), job.size, job.seed)
    else:
        trial = Trial((), job.size, job.seed, cause=job.key)
    hidden, log = hidden_log(trials, trial)
    options, began = trials.options(), time.process_time()
    model, data = pose(robot, log, options)
    terms = single_terms(model.robot) if job.named else hidden.terms
    problem = run(planned(model, data, terms))
    limit = Threshold(USUAL if job.named else -np.inf, ())
    made = run(search(problem, log, known(limit), options))
    return hidden, made.found, time.process_time() - began


def row(job: Job, drawn: Callable[[State], Posterior] | None = None) -> dict:
    """A line of the journal."""
    hidden, found, seconds = fitted(job)
    return told(job, hidden, found, seconds, drawn or draws)


def draws(found: State) -> Posterior:
    """Of the posterior of a search's end."""
    sample = found.data.sample(found.data.parts.chosen)
    return run(posterior(found.model, found.current, sample))


def told(job: Job, hidden: Hidden, found: State, seconds: float, drawn: Callable[[State], Posterior]) -> dict:
    """Of each parameter of the effect its truth, estimate, interval and rank; of the nameplate's their ranks."""
    out = {**vars(job), "seconds": seconds, "right": False}
    if not found.accepted or found.current.hypothesis.terms[0].key != hidden.terms[0].key:
        return out
    began = time.process_time()
    made = drawn(found)
    out |= {"right": True, "interval_seconds": time.process_time() - began}
    point, free = found.current, len(found.current.nominal)
    said = estimates(found.model, point, 0, made)
    values = found.model.coordinates.effect_values(point.hypothesis, made.z[:, free:])[0]
    parameters = hidden.terms[0].effect.parameters
    out["sizes"] = {
        p.name: {
            "true": float(true),
            "value": one.value,
            "low": one.low,
            "high": one.high,
            "rank": rank(column, made.weights, true),
        }
        for p, true, one, column in zip(parameters, hidden.values[0], said.values(), values.T, strict=True)
        if np.isfinite(true)
    }
    space, c = found.model.robot.space, found.model.coordinates
    z = c.from_values(hidden.parameters)
    out["nominal"] = {
        space.parameters[i].name: [rank(made.z[:, k], made.weights, z[k]), float(z[k]), float(point.z[k])]
        for k, i in enumerate(c.free)
        if np.isfinite(space.parameters[i].tolerance)
    }
    out |= {"power": made.power, "flat": made.flat, "draws": float(1.0 / np.sum(made.weights**2))}
    return out


def rank(values: np.ndarray, weights: np.ndarray, true: float) -> float:
    """In [0, 1]: the share of weighted draws (n,) below the truth; half of those that are equal to it."""
    return float(weights @ (values < true) + 0.5 * (weights @ (values == true)))


def rows(
    jobs: Sequence[Job], journal: Journal | None, processes: int, one: Callable[[Job], dict]
) -> list[dict]:
    """A row for each job; those in the journal are not made again."""
    key = lambda line: json.dumps([line[k] for k in ("key", "size", "seed", "named")])  # noqa: E731
    done = {key(line): line for line in journal.lines()} if journal else {}
    left = [job for job in jobs if key(vars(job)) not in done]
    for line in _made(left, processes, one):
        done[key(line)] = journal.add(line) if journal else line
        if len(done) % 25 == 0:
            print(f"{len(done)} of {len(jobs)} done", flush=True)
    return [done[key(vars(job))] for job in jobs]


def _made(left: Sequence[Job], processes: int, one: Callable[[Job], dict]) -> Iterable[dict]:
    if processes == 1:
        yield from map(one, left)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(one, left)


def table(title: str, found: Sequence[dict]) -> dict:
    """Print and return the table of some rows: by effect, and of all."""
    named = [one for one in found if one["right"] and one["sizes"]]
    print(f"\n{title}: {len(found)} robots, {len(named)} of them with the right name")
    print(
        f"  {'':24s} {'held':>14s} {'95 %':>14s} {'width':>7s} {'error':>7s} {'mean rank':>9s} {'power':>6s}"
    )
    out = {"robots": len(found), "right": len(named), "effects": {}}
    for key in dict.fromkeys(one["key"] for one in named):
        mine = [one for one in named if one["key"] == key]
        out["effects"][key] = _line(key, mine)
    out["all"] = _line("all", named)
    for size in dict.fromkeys(one["size"] for one in named):
        out[size] = _line(size, [one for one in named if one["size"] == size])
    ranks = np.array([_size(one)["rank"] for one in named])
    bins = np.histogram(ranks, bins=10, range=(0.0, 1.0))[0]
    out["ranks"] = {"bins": bins.tolist(), "ks": float(kstest(ranks, "uniform").pvalue)}
    print(f"  ranks in tenths {bins.tolist()}, uniform by Kolmogorov-Smirnov: p {out['ranks']['ks']:.2g}")
    other = [s for one in named for name, s in one["sizes"].items() if s is not _size(one)]
    if other:
        out["further"] = _held([s["low"] <= s["true"] <= s["high"] for s in other])
        print(f"  further parameters of effects: {_said(out['further'])}")
    out["nominal"] = {}
    for name in dict.fromkeys(n for one in named for n in one["nominal"]):
        ranks = np.array([one["nominal"][name][0] for one in named])
        inside = _held((ranks > 0.05) & (ranks < 0.95))
        out["nominal"][name] = inside
        print(f"  {name:24s} {_said(inside)}, tenths {np.histogram(ranks, 10, (0.0, 1.0))[0].tolist()}")
    seconds = [median(one[k] for one in named) for k in ("seconds", "interval_seconds")]
    out["seconds"] = dict(zip(("diagnosis", "interval"), seconds, strict=True))
    print(f"  core seconds: diagnosis {seconds[0]:.2f}, interval {seconds[1]:.3f} (medians)", flush=True)
    return out


def _line(name: str, some: Sequence[dict]) -> dict:
    """Print and return coverage, half width and error [of the true size], mean rank and power of some robots."""
    sizes = [_size(one) for one in some]
    held = _held([s["low"] <= s["true"] <= s["high"] for s in sizes])
    out = held | {
        "width": median((s["high"] - s["low"]) / (2 * abs(s["true"])) for s in sizes),
        "error": median(abs(s["value"] - s["true"]) / abs(s["true"]) for s in sizes),
        "rank": float(np.mean([s["rank"] for s in sizes])),
        "power": median(one["power"] for one in some),
    }
    print(
        f"  {name:24s} {out['hits']:4d}/{out['of']:<4d} {out['held']:4.2f} [{out['low']:.2f}, {out['high']:.2f}]"
        f" {out['width']:7.3f} {out['error']:7.3f} {out['rank']:9.2f} {out['power']:6.2f}"
    )
    return out


def _size(one: dict) -> dict:
    return next(iter(one["sizes"].values()))


def _held(which: Sequence[bool]) -> dict:
    """Share with its Clopper-Pearson interval of 95 %."""
    hits, of = int(np.sum(which)), len(which)
    low, high = binomtest(hits, of).proportion_ci(0.95)
    return {"held": hits / of, "low": float(low), "high": float(high), "hits": hits, "of": of}


def _said(held: dict) -> str:
    return f"{held['held']:.3f} [{held['low']:.2f}, {held['high']:.2f}] of {held['of']}"


def arguments() -> argparse.ArgumentParser:
    """What can be asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="servo_pendulum", choices=list(SECONDS))
    parser.add_argument("--truth", default="own", choices=TRUTHS)
    parser.add_argument("--robots", type=int, default=4, help="for each effect and size")
    parser.add_argument("--sizes", nargs="*", default=["medium", "strong"], choices=SIZES)
    parser.add_argument("--only", nargs="*", help="effects; all by default")
    parser.add_argument("--named", action="store_true", help="the diagnosis finds the name; right ones count")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    parser.add_argument("--seed", type=int, default=REPORT, help="of robots that are reported")
    parser.add_argument("--label", default="", help="of the journal: tables of other code stand beside it")
    return parser


def main() -> None:
    """Print a table and put it into benchmarks/results/intervals.json."""
    given = arguments().parse_args()
    jobs = of_robot(given)
    title = " ".join([given.robot, given.truth, *(["named"] if given.named else [])])
    head = {"title": title, "seed": TUNE if given.tune else given.seed, "label": given.label}
    stem = "_".join(["intervals", *title.split(), str(head["seed"]), given.label])
    journal = Journal(JOURNALS / f"{stem}.jsonl", head)
    journal.begin()
    out = table(title, rows(jobs, journal, given.processes, partial(row)))
    if not given.tune:
        results = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
        results[f"{title} {given.label}".strip()] = out
        FILE.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
