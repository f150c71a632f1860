"""Paper C: controllers that evolve in a displacement table, with and without its update, on robots that change.

Each evolution has its own hidden robot; at generation 800 one of its wheels (drawn) turns by 0.6 to 0.8 (drawn). At the
end the best controller is tried on it ten times for each heading. Success in trials is given beside the number of
evolutions of which at least 14 of 20 trials reach the target, for trials of one controller are no independent samples.
Besides, what the tests reject where nothing changed: one by one at 5 %, with the false-discovery rate controlled, and
the tests as printed (new samples held against all, themselves among them).

Every finished evolution is a line of the journal (`--journal`); a second start goes on.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from journal import Journal
from scipy.stats import binomtest

from dynreg.rng import stream, stream_seed
from dynreg.timed.evolve import Drift, HiddenWheels, evolve, judged, measured
from dynreg.timed.table import Rules, updated

HERE = Path(__file__).parent / "results"
TUNE, REPORT = 63, 20261211
CHANGES = 0.4  # of the evolution: generation 800 of 2000
ENOUGH = 0.7  # of the trials


@dataclass(frozen=True)
class Plan:
    """What makes it this table."""

    seed: int
    evolutions: int
    generations: int
    method: str


def robot_of(plan: Plan, number: int) -> HiddenWheels:
    """The hidden robot of an evolution."""
    rng = stream(plan.seed, "drift", number)
    factor, left = rng.uniform(0.6, 0.8), bool(rng.integers(2))
    drift = Drift(int(CHANGES * plan.generations), factor if left else 1.0, 1.0 if left else factor)
    return HiddenWheels((drift,), seed=stream_seed(plan.seed, "robot", number) % 2**31)


def work(plan: Plan, number: int, update: bool, path: Path) -> str:
    """One evolution, on one core; its name."""
    began, robot = time.process_time(), robot_of(plan, number)
    found = evolve(
        robot, update=update, generations=plan.generations, method=plan.method, seed=plan.seed + number
    )
    spent = robot.steps
    reached = judged(robot, found.genes).reached
    tests = [(int(u.rejected.sum()), u.tests) for u in found.updates]
    row = {
        "number": number,
        "update": update,
        "drift": asdict(robot.drifts[0]),
        "fitness": found.fitness,
        "up": reached[:, :2].ravel().tolist(),
        "right": reached[:, 2:].ravel().tolist(),
        "error": [float(found.error[0]), float(found.error[-1])],
        "visited": int(found.visited.sum()),
        "apart": found.apart[:, found.visited].mean(axis=1).tolist() if found.visited.any() else None,
        "tests": tests,
        "steps": spent,
        "core": time.process_time() - began,
    }
    Journal(path, {"plan": asdict(plan)}).add(row)
    return f"{number} {'with' if update else 'without'} update"


def still(seed: int, robots: int = 20) -> dict[str, dict[str, float]]:
    """Share of tests that reject where nothing changed: ten new samples of every command of as many robots."""
    kinds = {
        "student": Rules(),
        "welch": Rules(welch=True),
        "false-discovery rate": Rules(together=True),
        "as printed": Rules(apart=False),
    }
    out = {}
    for name, rules in kinds.items():
        rejected = tests = alarms = 0
        for number in range(robots):
            robot = HiddenWheels(seed=stream_seed(seed, "still", number) % 2**31)
            table, again = measured(robot), measured(robot)
            _, found = updated(table, again.cell, again.values, 50, rules)
            rejected += int(found.rejected.sum())
            tests += found.tests
            alarms += bool(found.rejected.any())
        out[name] = {"share": rejected / tests, "tests": tests, "robots with any": alarms / robots}
    return out


def show(rows: list[dict], rates: dict[str, dict[str, float]]) -> dict[str, dict]:
    """Print the table; its figures."""
    out: dict[str, dict] = {}
    for update in (True, False):
        own = [r for r in rows if r["update"] == update]
        if not own:
            continue
        trials = np.array([r["up"] + r["right"] for r in own], dtype=float)
        good = int((trials.mean(axis=1) >= ENOUGH).sum())
        interval = binomtest(good, len(own)).proportion_ci(0.9)
        before, after = np.array([r["error"] for r in own]).T
        rejected, tests = np.array([t for r in own for t in r["tests"]] or [[0, 0]]).sum(axis=0)
        name = "with update" if update else "without"
        apart = np.array([r["apart"] for r in own if r["apart"]])
        out[name] = {
            "evolutions": len(own),
            "success": float(trials.mean()),
            "by evolution": trials.mean(axis=1).tolist(),
            "up": float(np.mean([r["up"] for r in own])),
            "right": float(np.mean([r["right"] for r in own])),
            "good": good,
            "good interval": [interval.low, interval.high],
            "error at the beginning [mm]": float(1e3 * before.mean()),
            "error at the end [mm]": float(1e3 * after.mean()),
            "visited commands": float(np.mean([r["visited"] for r in own])),
            "error of those, first and last table [mm]": (1e3 * apart.mean(axis=0)).tolist()
            if len(apart)
            else None,
            "rejected": int(rejected),
            "tests": int(tests),
            "steps on the robot": float(np.mean([r["steps"] for r in own])),
            "core": float(np.mean([r["core"] for r in own])),
        }
        print(
            f"{name:12s} {len(own)} evolutions: {100 * trials.mean():.0f} % of the trials"
            f" (up {100 * out[name]['up']:.0f}, right {100 * out[name]['right']:.0f}), {good} evolutions reach"
            f" {100 * ENOUGH:.0f} % [{interval.low:.2f}, {interval.high:.2f}];"
            f" error of a command {1e3 * before.mean():.1f} mm at the beginning, {1e3 * after.mean():.1f} at the end;"
            f" {out[name]['steps on the robot']:.0f} steps, {out[name]['core']:.0f} core s"
        )
        if len(apart):
            first, last = 1e3 * apart.mean(axis=0)
            print(
                f"{'':12s} the {out[name]['visited commands']:.0f} commands given in trials: {first:.1f} mm in"
                f" the first table, {last:.1f} in the last"
            )
    for name, rate in rates.items():
        print(
            f"nothing changed, {name}: {100 * rate['share']:.2f} % of {rate['tests']} tests reject,"
            f" {100 * rate['robots with any']:.0f} % of the robots have any"
        )
    return out | {"nothing changed": rates}


def main() -> None:
    """Fill in what is left, print, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--evolutions", type=int, default=10, help="in each arm")
    parser.add_argument("--generations", type=int, default=2000)
    parser.add_argument("--method", choices=("operon", "bits"), default="operon")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--journal", type=Path)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    plan = Plan(seed, given.evolutions, given.generations, given.method)
    path = given.journal or HERE / f"wheeled_drift_{plan.method}.jsonl"
    journal = Journal(path, {"plan": asdict(plan)})
    journal.begin()
    done = {(row["number"], row["update"]) for row in journal.lines()}
    jobs = [(n, u) for n in range(plan.evolutions) for u in (True, False) if (n, u) not in done]
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(work, plan, *job, path) for job in jobs]):
            print(future.result(), flush=True)
    out = show(journal.lines(), still(plan.seed))
    if not given.tune:
        (HERE / f"wheeled_drift_{plan.method}.json").write_text(
            json.dumps({"plan": asdict(plan), **out}, indent=1) + "\n"
        )


if __name__ == "__main__":
    main()
