"""Paper C: controllers that evolve in a displacement table, with and without its update.

Robots are of two kinds (`--robots`). `changing`: the table is measured on the robot itself; at generation 800 one of
its wheels (drawn) turns by 0.6 to 0.8 (drawn). `static`, as in the paper's Table 1: nothing changes, and the table is
that of another robot, which drives arcs as told, while the robot follows with the lags of Pretorius et al., Table II,
and gets 0.6 to 0.8 (drawn) out of one wheel (drawn), all out of it where it is told to turn slower than before. What a
command does then depends on the one before it, which no table of commands holds.

At the end the best controller is tried ten times for each heading. Success in trials is given beside the number of
evolutions of which at least 14 of 20 trials reach the target, for trials of one controller are no independent samples;
intervals of shares are of 90 %, bootstrap over evolutions, of counts Clopper and Pearson's. The gap is the mean
distance between where the controller is in the last table and on the robot at the same step. Besides, what the tests
reject where nothing changed: one by one at 5 %, with the false-discovery rate controlled, and the tests as printed (new
samples held against all, themselves among them).

Every finished evolution is a line of the journal (`--journal`); a second start goes on. `wheeled_pictures.py` draws
what the result keeps.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from bootstrap import interval
from journal import Journal
from kept import RESULTS
from scipy.stats import binomtest

from dynreg.rng import stream, stream_seed
from dynreg.timed.evolve import (
    EVERY,
    SAMPLE,
    Drift,
    Evolution,
    HiddenWheels,
    evolve,
    judged,
    measured,
    mover_of,
)
from dynreg.timed.goal import Trials, tried
from dynreg.timed.pulsed import Controllers
from dynreg.timed.table import DisplacementTable, Rules, updated
from dynreg.timed.worn import WornWheels

TUNE, REPORT = 63, {"changing": 20261211, "static": 20261218}
GIVES = (0.6, 0.8)  # of what the wheel is told
CHANGES = 0.4  # of the evolution: generation 800 of 2000
ENOUGH = 0.7  # of the trials
# % of trials, up, right and all, with update and without
PUBLISHED = {True: (40, 100, 70), False: (10, 0, 5)}
TIMES = 10  # trials for each heading


@dataclass(frozen=True)
class Plan:
    """What makes it this table."""

    seed: int
    evolutions: int
    generations: int
    method: str
    robots: str


def robot_of(plan: Plan, number: int) -> tuple[HiddenWheels, DisplacementTable]:
    """The hidden robot of an evolution, and the table to begin with."""
    rng = stream(plan.seed, "drift", number)
    factor, left = rng.uniform(*GIVES), bool(rng.integers(2))
    sides = (factor, 1.0) if left else (1.0, factor)
    seed = stream_seed(plan.seed, "robot", number) % 2**31
    if plan.robots == "static":
        another = HiddenWheels(seed=stream_seed(plan.seed, "another robot", number) % 2**31)
        return HiddenWheels(worn=WornWheels(*sides), seed=seed), measured(another)
    robot = HiddenWheels((Drift(int(CHANGES * plan.generations), *sides),), seed=seed)
    return robot, measured(robot)


def work(plan: Plan, number: int, update: bool, path: Path) -> str:
    """One evolution, on one core; its name."""
    began, (robot, table) = time.process_time(), robot_of(plan, number)
    found = evolve(
        robot,
        first=table,
        update=update,
        generations=plan.generations,
        method=plan.method,
        seed=plan.seed + number,
    )
    steps = round(robot.spent.seconds / SAMPLE)
    there = judged(robot, found.genes, TIMES)
    again = np.tile(found.genes, (len(there.reached), 1))
    here = tried(Controllers.of(again), mover_of(found.table, stream(plan.seed, "shown", number)))
    row = {
        "number": number,
        "update": update,
        "drifts": [asdict(d) for d in robot.drifts],
        "worn": asdict(robot.worn) if robot.worn else None,
        "fitness": found.fitness,
        "up": there.reached[:, :2].ravel().tolist(),
        "right": there.reached[:, 2:].ravel().tolist(),
        "in the table": here.reached.mean(axis=0).tolist(),
        "gap": _gap(here, there),
        "ways": {name: _ways(trials) for name, trials in (("table", here), ("robot", there))},
        "history": found.history[EVERY - 1 :: EVERY].tolist(),
        "leaders": _led(robot, found),
        "error": [float(found.error[0]), float(found.error[-1])],
        "visited": int(found.visited.sum()),
        "apart": found.apart[:, found.visited].mean(axis=1).tolist() if found.visited.any() else None,
        "tests": [(int(u.rejected.sum()), u.tests) for u in found.updates],
        "steps": steps,
        "core": time.process_time() - began,
    }
    Journal(path, {"plan": asdict(plan)}).add(row)
    return f"{number} {'with' if update else 'without'} update"


def _gap(here: Trials, there: Trials) -> list[float]:
    """Up and right: mean distance [m] of two sets of trials at the same step."""
    apart = np.linalg.norm((here.ways - there.ways)[..., :2], axis=-1).mean(axis=(0, 2))
    return apart.reshape(2, 2).mean(axis=1).tolist()


def _ways(trials: Trials) -> list[list[list[int]]]:
    """The first way up and the first right [mm]."""
    return np.round(1e3 * trials.ways[0, [0, 2], :, :2]).astype(int).tolist()


def _led(robot: HiddenWheels, found: Evolution) -> list[float]:
    """Share of four trials in which the best at the time reaches the target on the robot as it was then."""
    out = []
    for count, genes in enumerate(found.leaders, start=1):
        robot.generation = count * EVERY - 1
        out.append(float(judged(robot, genes, times=2).reached.mean()))
    return out


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
        if own:
            out["with update" if update else "without"] = figures = _figures(own)
            _told("with update" if update else "without", figures, PUBLISHED[update])
    for name, rate in rates.items():
        print(
            f"nothing changed, {name}: {100 * rate['share']:.2f} % of {rate['tests']} tests reject,"
            f" {100 * rate['robots with any']:.0f} % of the robots have any"
        )
    return out | {"nothing changed": rates}


def _figures(own: list[dict]) -> dict:
    """Of evolutions of one arm."""
    trials = np.array([[np.mean(r["up"]), np.mean(r["right"])] for r in own])
    whole = trials.mean(axis=1)
    good = int((whole >= ENOUGH - 1e-9).sum())
    share = binomtest(good, len(own)).proportion_ci(0.9)
    before, after = np.array([r["error"] for r in own]).T
    rejected, tests = np.array([t for r in own for t in r["tests"]] or [[0, 0]]).sum(axis=0)
    apart = np.array([r["apart"] for r in own if r["apart"]])
    inside = np.array([r["in the table"] for r in own]).reshape(-1, 2, 2).mean(axis=2)
    return {
        "evolutions": len(own),
        "success": interval(whole),
        "by evolution": whole.tolist(),
        "up": interval(trials[:, 0]),
        "right": interval(trials[:, 1]),
        "in the table, up and right": inside.mean(axis=0).tolist(),
        "good": good,
        "good interval": [share.low, share.high],
        "gap, up and right [mm]": [interval(1e3 * g) for g in np.array([r["gap"] for r in own]).T],
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
        "fitness in the table": np.mean([r["history"] for r in own], axis=0).tolist(),
        "success of the best": np.mean([r["leaders"] for r in own], axis=0).tolist(),
        "ways": own[0]["ways"],
    }


def _told(name: str, of: dict, published: tuple[int, int, int]) -> None:
    shares = [
        "{:.0f} [{:.0f}, {:.0f}]".format(*(100 * v for v in of[key])) for key in ("up", "right", "success")
    ]
    gaps = ["{:.0f} [{:.0f}, {:.0f}]".format(*gap) for gap in of["gap, up and right [mm]"]]
    inside = "{:.0f}, {:.0f}".format(*(100 * v for v in of["in the table, up and right"]))
    print(
        f"{name:12s} {of['evolutions']} evolutions: % of trials up {shares[0]}, right {shares[1]}, all {shares[2]}"
        f" (published {published}), in the table {inside}; {of['good']} evolutions reach {100 * ENOUGH:.0f} %"
        f" [{of['good interval'][0]:.2f}, {of['good interval'][1]:.2f}]\n"
        f"{'':12s} gap of the ways up {gaps[0]} mm, right {gaps[1]} mm; error of a command"
        f" {of['error at the beginning [mm]']:.1f} mm at the beginning, {of['error at the end [mm]']:.1f} at the end;"
        f" {of['steps on the robot']:.0f} steps, {of['core']:.0f} core s"
    )
    if of["error of those, first and last table [mm]"]:
        first, last = of["error of those, first and last table [mm]"]
        print(
            f"{'':12s} the {of['visited commands']:.0f} commands given in trials: {first:.1f} mm in"
            f" the first table, {last:.1f} in the last"
        )


def main() -> None:
    """Fill in what is left, print, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--evolutions", type=int, default=10, help="in each arm")
    parser.add_argument("--generations", type=int, default=2000)
    parser.add_argument("--method", choices=("operon", "bits"), default="operon")
    parser.add_argument("--robots", choices=tuple(REPORT), default="changing")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--journal", type=Path)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no result")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT[given.robots]
    plan = Plan(seed, given.evolutions, given.generations, given.method, given.robots)
    name = f"wheeled_{'static' if plan.robots == 'static' else 'drift'}_{plan.method}"
    path = given.journal or RESULTS / f"{name}{'_tune' if given.tune else ''}.jsonl"
    journal = Journal(path, {"plan": asdict(plan)})
    journal.begin()
    done = {(row["number"], row["update"]) for row in journal.lines()}
    jobs = [(n, u) for n in range(plan.evolutions) for u in (True, False) if (n, u) not in done]
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(work, plan, *job, path) for job in jobs]):
            print(future.result(), flush=True)
    out = show(journal.lines(), still(plan.seed))
    if not given.tune:
        (RESULTS / f"{name}.json").write_text(json.dumps({"plan": asdict(plan), **out}, indent=1) + "\n")


if __name__ == "__main__":
    main()
