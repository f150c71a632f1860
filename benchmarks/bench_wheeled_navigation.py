"""Ten commands that visit four corners, evolved in each simulator and tried once on the robot (paper A, Table V).

Hidden robots are drawn from the nameplate of `diffdrive` by other code than the simulators' (`dynreg.truths`, steps of
1 ms), and four in a row hide four effects, one each: a wheel that turns faster than the other, a speed lost in turns, a
dead band, wheels that slip. Sizes were chosen on the robots of `--tune` so that the fitted unicycle is off on a command
by about what the paper prints (Table III). What is systematic and what is random is a choice, for the paper does not
tell them apart: all that the models get wrong is systematic, and random is what a tracker and drives do (1 mm and 0.5
degrees of a pose, 0.5 % of the wheels' fastest speed in every command of 20 ms). So the row "truth", plans that evolve
in the robot itself, shows what the noise alone takes. A delay is none of the effects: the unicycle's lag takes it up
(`bench_wheeled_extended.py`), and its errors are never as large as published.

For each robot: 1460 commands; 1000 to fit, 230 to validate, 230 to test. The diagnosis sees the first 12 minutes. The
unicycle is fitted by least squares, the minimum that the genetic algorithm comes to (`bench_wheeled_ga.py`). Plans
evolve in the closed form, the unicycle in steps of 50 ms, the networks, and, in compiled equations in steps of 20 ms,
in the diagnosed and extended simulator and in the truth. What a simulator says of its best plan is, for the unicycle,
by steps of 10 ms, for the extended one by the registry's own engine, for the truth by its own steps of 1 ms. The best
plan of each evolution is driven once by the robot. Success is by blocks missed; the gap is the absolute difference
between fitness in the simulator and on the robot. Intervals are of 90 %: bootstrap over evolutions, of counts Clopper
and Pearson's; Fisher's exact test between simulators' counts of plans that miss no block.

By default at the paper's size, 20 evolutions of 10,000 generations of 200 in each simulator; `--small` takes 12 of 500.
How much fitness grows with generations is printed as well. A table of another number of generations than the small
one's is kept beside that. `--tune` takes the robots of the development, with a journal of its own, and writes no
result.

Every finished robot and evolution is a line of the journal (`--journal`); a second start goes on. `wheeled_pictures.py`
draws the paths that the result keeps.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from bootstrap import interval
from journal import Journal
from kept import RESULTS
from scipy.stats import binomtest, fisher_exact
from wheeled_robots import Exact, hidden, made, sayers_of, simulators_of, truth_of

from dynreg.rng import stream_seed
from dynreg.timed.commands import AXES
from dynreg.timed.navigation import COMMANDS, PLANNING, Plan, driven, evolve, fitness
from dynreg.timed.navigation import Path as Way

TUNE, REPORT = 65, 20261230
SMALL = (12, 500)  # evolutions in each simulator, generations
AGAIN = 40  # times that a plan is driven once more
AFTER = (250, 500, 1000, 2000, 5000, 10_000)  # generations at which fitness is printed
KINDS = ("kinematic", "dynamic", "network", "extended", "truth")
PUBLISHED = {  # gap: mean, least, most; plans that miss 0, 1, 2 blocks
    "network": ((328.91, 13.90, 2299.27), (17, 1, 2)),
    "dynamic": ((393.35, 9.52, 2267.64), (15, 4, 1)),
    "kinematic": ((745.81, 21.33, 2271.56), (11, 6, 3)),
}
ERRORS = {  # Table III, mean and standard deviation: cm, cm, degrees
    "network": ((0.4483, 0.5485), (0.6241, 0.6014), (3.0239, 3.3638)),
    "dynamic": ((0.3467, 0.6586), (0.3628, 0.4363), (4.1985, 3.9652)),
    "kinematic": ((1.0093, 1.7967), (1.2788, 1.5346), (13.2385, 10.1716)),
}


@dataclass(frozen=True)
class Table:
    """What makes it this table."""

    seed: int
    robots: int
    evolutions: int
    generations: int
    starts: int
    threshold_runs: int


def make(table: Table, number: int, path: Path) -> str:
    """One hidden robot and what its log makes; what it hides, and what a diagnosis says."""
    began, truth = time.process_time(), hidden(table.seed, number)
    row = made(truth, starts=table.starts, threshold_runs=table.threshold_runs)
    head = {"robot": number, "core": time.process_time() - began}
    Journal(path, {"table": asdict(table)}).add(head | row)
    named = ", ".join(key for key, _ in row["named"]) or "nothing"
    return f"robot {number} hides {truth.cause}: {row['verdict']}, {named}; {head['core']:.0f} core s"


def work(table: Table, kind: str, number: int, path: Path) -> str:
    """One evolution in one simulator, and its best plan on the robot; what came of it."""
    journal, began = Journal(path, {"table": asdict(table)}), time.process_time()
    row = next(r for r in journal.lines() if r.get("robot") == number % table.robots)
    seed = stream_seed(table.seed, kind, number) % 2**31
    best = evolve(simulators_of(row)[kind], generations=table.generations, seed=seed)
    plan, many = (Plan.of(np.repeat(best.genes[None], n, axis=0)) for n in (1, AGAIN))
    salt = stream_seed(seed, "robot") % 2**31
    truth = truth_of(row)
    here, there = driven(plan, sayers_of(row)[kind]), driven(plan, Exact(truth, noisy=True, salt=salt))
    (simulated, thought), (real, blocks) = fitness(here), fitness(there)
    often, visited = fitness(driven(many, Exact(truth, noisy=True, salt=salt + 1)))
    found = {
        "kind": kind,
        "number": number,
        "hidden": truth.cause,
        "genes": best.genes.tolist(),
        "simulated": float(simulated[0]),
        "thought": int(thought[0]),
        "real": float(real[0]),
        "blocks": int(blocks[0]),
        "share": float((visited == 4).mean()),
        "often": float(np.abs(often - simulated[0]).mean()),
        "commands": COMMANDS - int(plan.null.sum()),
        "after": [
            _reached(best.history, PLANNING.population * count)
            for count in AFTER
            if count <= table.generations
        ],
        "ways": {"simulator": _way(here), "robot": _way(there)},
        "core": time.process_time() - began,
    }
    journal.add(found)
    return f"{kind} {number}: {simulated[0]:.0f} simulated, {real[0]:.0f} on the robot, {blocks[0]} blocks"


def _reached(history: tuple[tuple[int, float], ...], tried: int) -> float:
    """The best fitness after so many candidates."""
    return [value for count, value in history if count <= tried][-1]


def _way(path: Way) -> list[list[int]]:
    """Points of the first path [mm], from the middle on."""
    points = path.points[0, ..., :2].reshape(-1, 2)
    known = points[np.isfinite(points).all(axis=1)]
    return [[0, 0], *np.round(1e3 * known).astype(int).tolist()]


def show(rows: list[dict]) -> dict[str, dict]:
    """Print the tables; their figures."""
    robots = [r for r in rows if "robot" in r]
    out: dict[str, dict] = {"robots": {"core": sum(r["core"] for r in robots), "errors": _errors(robots)}}
    out["robots"]["named"] = [[r["hidden"][0], r["verdict"], r["named"]] for r in robots]
    for kind in KINDS:
        own = [r for r in rows if r.get("kind") == kind]
        if own:
            out[kind] = figures = _figures(own)
            _told(kind, figures, len(own))
    tested = {}
    for first, second in combinations([k for k in KINDS if k in out], 2):
        counts = [[out[k]["missed"][0], sum(out[k]["missed"][1:])] for k in (first, second)]
        tested[f"{first} and {second}"] = float(fisher_exact(counts).pvalue)
        print(f"{first} and {second}: Fisher p {tested[f'{first} and {second}']:.3g}")
    return out | {"fisher": tested}


def _errors(robots: list[dict]) -> dict[str, list[list[float]]]:
    """Mean and standard deviation of absolute errors by axis, on average over robots; printed beside Table III."""
    out = {}
    for kind in (k for k in KINDS if k != "truth"):
        of = np.array([[r["errors"][kind][axis] for axis in AXES] for r in robots])[..., [0, 3]]
        out[kind] = of.mean(axis=0).tolist()
        ours = ", ".join(f"{m:.2f} ({sd:.2f})" for m, sd in out[kind])
        theirs = ", ".join(f"{m:.2f} ({sd:.2f})" for m, sd in ERRORS.get(kind, ()))
        print(f"{kind:10s} errors of a command, cm, cm, deg (SD): {ours}; published {theirs or 'none'}")
    return out


def _figures(own: list[dict]) -> dict:
    """Of the evolutions in one simulator."""
    gaps = np.array([abs(r["simulated"] - r["real"]) for r in own])
    missed, kinds = np.bincount([4 - r["blocks"] for r in own], minlength=5), [r["hidden"] for r in own]
    share = binomtest(int(missed[0]), len(own)).proportion_ci(0.9)
    again, often = (interval(np.array([r[key] for r in own])) for key in ("share", "often"))
    return {
        "gap": interval(gaps),
        "least and most": [float(gaps.min()), float(gaps.max())],
        "missed": missed.tolist(),
        "four in the simulator": sum(r["thought"] == 4 for r in own),
        "success": [share.low, share.high],
        "kept of those": sum(r["thought"] == 4 == r["blocks"] for r in own),
        "by effect": {
            name: [sum(r["blocks"] == 4 for r in own if r["hidden"] == name), kinds.count(name)]
            for name in sorted(set(kinds))
        },
        "again": {"success": again, "gap": often},
        "after": {str(c): v for c, v in zip(AFTER, np.mean([r["after"] for r in own], axis=0), strict=False)},
        "core": float(sum(r["core"] for r in own)),
        "ways": own[0]["ways"],
    }


def _told(kind: str, of: dict, many: int) -> None:
    gap, missed = (PUBLISHED[kind][0], PUBLISHED[kind][1]) if kind in PUBLISHED else ("none", "none")
    print(
        f"{kind:10s} gap {_shown(of['gap'])}, {of['least and most'][0]:.1f} to {of['least and most'][1]:.1f}"
        f" (published {gap}); {of['missed'][0]} of {many} miss no block"
        f" [{of['success'][0]:.2f}, {of['success'][1]:.2f}], {of['missed'][1:]} miss 1, 2, 3, 4 (published {missed});"
        f" {of['core']:.0f} core s\n"
        f"{'':10s} {of['four in the simulator']} visit all four in their simulator, {of['kept of those']} of them"
        f" on the robot; driven {AGAIN} times:"
        f" {_shown([100 * v for v in of['again']['success']])} % miss no block, gap {_shown(of['again']['gap'])};"
        f" by effect {of['by effect']}; fitness after"
        f" {', '.join(f'{c} generations {v:.0f}' for c, v in of['after'].items())}"
    )


def _shown(found: list[float]) -> str:
    return f"{found[0]:.1f} [{found[1]:.1f}, {found[2]:.1f}]"


def main() -> None:
    """Fill in what is left, print, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=4, help="evolutions take them in turn")
    parser.add_argument("--evolutions", type=int, help="in each simulator [20, small 12]")
    parser.add_argument("--generations", type=int, help="[10000, small 500]")
    parser.add_argument("--small", action="store_true", help="a smaller size than the paper's")
    parser.add_argument("--starts", type=int, default=4, help="of the networks")
    parser.add_argument("--threshold-runs", type=int, default=0, help="of the diagnosis")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--journal", type=Path)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no result")
    given = parser.parse_args()
    size = SMALL if given.small else (20, 10_000)
    table = Table(
        TUNE if given.tune else REPORT,
        given.robots,
        given.evolutions or size[0],
        given.generations or size[1],
        given.starts,
        given.threshold_runs,
    )
    ending = "_tune" if given.tune else "" if table.generations == SMALL[1] else f"_{table.generations}"
    path = given.journal or RESULTS / f"wheeled_navigation{ending}.jsonl"
    journal = Journal(path, {"table": asdict(table)})
    journal.begin()
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        known = {row["robot"] for row in journal.lines() if "robot" in row}
        left = [(make, n) for n in range(table.robots) if n not in known]
        for future in as_completed([pool.submit(make, table, n, path) for _, n in left]):
            print(future.result(), flush=True)
        done = {(row["kind"], row["number"]) for row in journal.lines() if "kind" in row}
        jobs = [(k, n) for n in range(table.evolutions) for k in given.kinds if (k, n) not in done]
        for future in as_completed([pool.submit(work, table, *job, path) for job in jobs]):
            print(future.result(), flush=True)
    out = {"table": asdict(table), **show(journal.lines())}
    if not given.tune:
        (RESULTS / f"wheeled_navigation{ending}.json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
