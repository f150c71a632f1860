"""Simulators with one effect each rank the causes of hidden robots: beside screening, and in a diagnosis.

Tuning (`--tune`) and reporting seeds are apart. The population is made once for the protocol; robots are hidden by the
library's own effects ("own") or by other code ("independent"). For each robot: where its right name stands in the
ranking and in the order of screening, the flag "none of the known causes looks like this", and with --diagnose the
verdicts and seconds with the ranking and without.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from journal import Journal
from kept import RESULTS
from naming import TUNE, seeds
from scipy.stats import beta

from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.diagnose import search
from dynreg.diagnose.guided import EACH, MOST
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.screen import screen
from dynreg.diagnose.threshold import Threshold, known
from dynreg.diagnose.trial import Trial, Trials, hidden_log, posed, right_names
from dynreg.evidence.fit import best_of, fit
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import Search, run
from dynreg.evidence.truth import protocol
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import load_robot
from dynreg.truths.table import causes_of

FILE = RESULTS / "ranker.json"
REPORT = 20261124
NEEDED = 8.1  # nats: the threshold of the servo bench (bench_naming)
OUTSIDE = 99  # place of what is not in an order


def wanted(given: argparse.Namespace, trials: Trials, seed: int) -> list[tuple[str, str, int, Trial]]:
    """(cause, size, number, trial) of the robots: every cause at every size, then robots with nothing hidden."""
    if given.truth == "own":
        causes = [t.key for t in single_terms(trials.robot) if not t.joints]
    else:
        name = trials.robot.name
        causes = [c for physics in ("other", "same") for c in causes_of(name, physics)]
    out = []
    for i in range(given.robots):
        for size in given.sizes:
            for cause in causes:
                own = seeds(seed, given.truth, cause, size, n=i + 1)[i]
                terms = (term(cause),) if given.truth == "own" else ()
                out.append((cause, size, i, Trial(terms, size, own, cause=None if terms else cause)))
    for i, own in enumerate(seeds(seed, given.truth, "nothing", n=given.none)):
        out.append(("", "none", i, Trial((), None, own)))
    return out


def screened(problem: Problem) -> Search[list[str]]:
    """Keys of the terms in the order of screening: one iteration of the best starts, as `Short` orders them."""
    found = yield from calibrate(problem.model, problem.data, draws=problem.plan.draws)
    starts, slope = yield from screen(found.model, found.point, problem.terms, found.sample)
    begun, cost = yield from fit(found.model, starts, found.sample, iterations=1, leading=slope)
    return list(dict.fromkeys(p.hypothesis.key for p in best_of(begun, cost)))


def told(trials: Trials, trial: Trial, by_screening: bool, diagnose: bool) -> dict:
    """What is found of one robot."""
    hidden, recording = hidden_log(trials, trial)
    options = trials.options()
    problem = run(posed(trials, recording, options), threads=1)
    right = set().union(*right_names(trials.robot, hidden))
    began = time.process_time()
    ranking = run(problem.guide.ranking(problem.model, problem.data, problem.terms), threads=1)
    out = {
        "seconds": time.process_time() - began,
        "inside": bool(right),
        "rank": _place(ranking.keys, right),
        "first": ranking.keys[0],
        "resemblance": ranking.resemblance,
        "outside": ranking.outside,
        "size": ranking.size / ranking.noise,
    }
    if by_screening:
        began = time.process_time()
        out["screen"] = _place(run(screened(problem), threads=1), right)
        out["screen seconds"] = time.process_time() - began
    for how, guide in (("with", problem.guide), ("without", None)) if diagnose else ():
        began = time.process_time()
        own = Problem(problem.model, problem.data, problem.terms, problem.plan, guide)
        made = run(search(own, recording, known(Threshold(NEEDED, ())), options), threads=1)
        first = made.found.rounds[0].chosen.point.hypothesis.terms[-1].key if made.found.accepted else ""
        out[how] = {
            "name": first,
            "right": first in right if first else not hidden.key and not hidden.cause,
            "verdict": made.verdict,
            "seconds": time.process_time() - began,
        }
    return out


def _place(keys: list[str], right: set[str]) -> int:
    return min((keys.index(key) for key in right if key in keys), default=OUTSIDE)


def share(hits: int, of: int) -> dict[str, float]:
    """A share with its 95 % interval (Clopper and Pearson 1934)."""
    low = beta.ppf(0.025, hits, of - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, of - hits) if hits < of else 1.0
    return {"hits": hits, "of": of, "low": float(low), "high": float(high)}


def table(lines: list[dict]) -> dict:
    """{row: {column: share}} by size, then seconds and what a diagnosis is with the ranking and without."""
    out: dict = {}
    for size in (*SIZES, "none"):
        of_size = [x["found"] for x in lines if x["size_of"] == size]
        inside = [x for x in of_size if x["inside"]]
        row = {}
        for what in ("rank", "screen"):
            known_place = [x[what] for x in inside if what in x]
            for k in (1, 3, 5) if known_place else ():
                row[f"{what}, first {k}"] = share(sum(place < k for place in known_place), len(known_place))
        for name, some in (("in the library", inside), ("not", [x for x in of_size if not x["inside"]])):
            if some:
                row[f"flagged, {name}"] = share(sum(x["outside"] for x in some), len(some))
        out |= {size: row} if row else {}
    out["seconds"] = {"a ranking": float(np.median([x["found"]["seconds"] for x in lines]))}
    spent = [x["found"]["screen seconds"] for x in lines if "screen seconds" in x["found"]]
    out["seconds"] |= {"a screening": float(np.median(spent))} if spent else {}
    both = [x["found"] for x in lines if "with" in x["found"]]
    for how in ("without", "with") if both else ():
        own = [x[how] for x in both]
        sure = [x for x in own if x["verdict"] in ("named", "ambiguous")]
        out[f"diagnosis {how}"] = {
            "right": share(sum(x["right"] for x in own), len(own)),
            "confident and wrong": share(sum(not x["right"] for x in sure), len(own)),
        }
        out["seconds"][f"a diagnosis {how}"] = float(np.mean([x["seconds"] for x in own]))
    if both:
        turned = [(x["without"]["right"], x["with"]["right"]) for x in both]
        out["turned"] = {"right": turned.count((False, True)), "wrong": turned.count((True, False))}
    return out


def show(out: dict) -> None:
    """Print a table."""
    for row, columns in out.items():
        for name, x in columns.items():
            said = (
                f"{x['hits']} of {x['of']} ({100 * x['low']:.0f} to {100 * x['high']:.0f} %)"
                if isinstance(x, dict)
                else f"{x:.3g}"
            )
            print(f"{row:18} {name:24} {said}")


def main() -> None:
    """Print the tables; those of the reporting seeds are kept in benchmarks/results/."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="servo_pendulum")
    parser.add_argument("--truth", choices=("own", "independent"), default="own")
    parser.add_argument("--sizes", nargs="*", default=list(SIZES), choices=SIZES)
    parser.add_argument("--robots", type=int, default=1, help="for each cause and size")
    parser.add_argument("--entries", type=int, help=f"of the population ({EACH} a term, {MOST} at most)")
    parser.add_argument("--none", type=int, default=20, help="robots with nothing hidden")
    parser.add_argument(
        "--screened", type=int, help="robots whose causes are also ordered by screening [all]"
    )
    parser.add_argument("--diagnose", action="store_true", help="also diagnose, with the ranking and without")
    parser.add_argument("--tune", action="store_true", help="the seeds of the development; writes nothing")
    parser.add_argument("--journal", type=Path, help="of the robots: a second start goes on")
    given = parser.parse_args()
    robot, seed = load_robot(given.robot), TUNE if given.tune else REPORT
    trials = Trials(robot, protocol(robot, seed=TUNE), threads=1, seed=TUNE, ranker="make", truth=given.truth)
    began = time.process_time()
    trials = trials.guided(count=given.entries)
    count, spent = len(trials.guide.population), time.process_time() - began
    print(f"{count} entries: {spent:.1f} s, {1e3 * spent / count:.1f} ms each", flush=True)
    ending = "_tune" if given.tune else ""
    path = given.journal or RESULTS / f"ranker_{given.robot}_{given.truth}{ending}.jsonl"
    journal = Journal(path, {"robot": robot.hash, "seed": seed, "truth": given.truth, "entries": count})
    journal.begin()
    done = {(x["cause"], x["size_of"], x["number"]) for x in journal.lines()}
    for i, (cause, size, number, trial) in enumerate(wanted(given, trials, seed)):
        if (cause, size, number) not in done:
            found = told(trials, trial, given.screened is None or i < given.screened, given.diagnose)
            print(cause or "nothing", size, json.dumps(found), flush=True)
            journal.add({"cause": cause, "size_of": size, "number": number, "found": found})
    out = table(journal.lines())
    show(out)
    if not given.tune:
        kept = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
        kept |= {f"{given.robot}, {given.truth}": {"plan": {"entries": count, "seed": seed}, **out}}
        FILE.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
