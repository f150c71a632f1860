"""Hidden quadrupeds: how well each way of choosing a simulator predicts a second of unseen commands.

Rollout error: mean absolute error of joint angles, attitude and body velocity, in units of the population's
spread, over 8 seconds of commands that nobody saw; a random entry = 1.00. Simulators predict without motor
noise, the hidden robot moves with it. Robots for reporting have seeds of their own (`REPORT`), apart from those
used in development (`TUNE`).
"""

import argparse
import json
import time

import numpy as np
from hidden import Hidden, errors_of, hidden_robots
from kept import RESULTS

import dynreg
from dynreg.distance.query import DistanceQuery
from dynreg.neighbours.retrieve import retrieve
from dynreg.replay.cut import windows
from dynreg.replay.known import known_values
from dynreg.replay.windows import Replayer
from dynreg.replay.windows import errors as replay_errors
from dynreg.rng import stream
from dynreg.sim.excitation import excitation
from dynreg.verbs.populations import load_population
from dynreg.verbs.query import QuerySettings, query
from dynreg.verbs.subjects import Recorded

TUNE, REPORT = 777, 20261123
FILE = RESULTS / "quadruped.json"
RETRIEVED = ("cross_loss", "cross_loss_train", "one_sided", "embedding", "trajectory")


def measure(registry, population, hidden: Hidden, kind: str, budget: int | None) -> dict[str, float]:
    """Rollout errors of every method for one hidden robot, relative to random entries."""
    robot = population.shared.robot
    bank = population.shared.run
    own = excitation(robot, seed=hidden.seed, name=f"own {hidden.number}")
    log = hidden.log(bank if kind == "shared" else own, kind)
    chosen = {"nominal": robot.space.nominal[None]}
    random = stream(hidden.seed, "random", hidden.number).permutation(len(population))[:25]
    chosen["random"] = population.entries.values[random]
    chosen["itself"] = hidden.values[None, : len(robot.space)]
    known = known_values(robot, log)
    replayer = Replayer(robot, windows(robot, log))
    every = np.arange(len(replayer.windows))
    replayed = lambda unit: replay_errors(  # noqa: E731
        replayer.residuals(robot.space.from_unit(unit), every)
    ).mean(axis=1)
    for distance in RETRIEVED:
        if distance == "trajectory" and kind == "own":
            continue
        found = retrieve(DistanceQuery(population, log, replayed, known, wanted=5), distance)
        chosen[distance] = population.entries.values[found.ranked.order[:5]]
    began = time.perf_counter()
    answer = query(
        Recorded(registry, robot, log, log.id[:12]),
        QuerySettings(hold_out="0", budget=budget),
        population=population,
    )
    seconds = time.perf_counter() - began
    order = {e: i for i, e in enumerate(population.entries.ids)}
    chosen["replayed"] = population.entries.values[[order[n.entry] for n in answer.neighbours]]
    made = {name: p.value for name, p in answer.synthesised.parameters.items()}
    chosen["synthesised"] = robot.space.from_dict(made)[None]
    chosen["answer"] = robot.space.from_dict(answer.answer_parameters)[None]
    errors = errors_of(population, hidden, chosen)
    scale = errors["random"]
    return {k: v / scale for k, v in errors.items()} | {
        "seconds": seconds,
        "alarm": float(not answer.fits),
        "rollouts": answer.cost.rollouts,
        "misfit": answer.misfit,
    }


def table(rows: list[dict[str, float]], title: str) -> dict[str, dict[str, float]]:
    """Print and return mean and 90 % bootstrap interval over robots of every column."""
    print(f"\n{title}: {len(rows)} hidden robots, rollout error (random entry = 1.00)")
    out = {}
    rng = np.random.default_rng(0)
    for key in rows[0]:
        x = np.array([r[key] for r in rows])
        draws = x[rng.integers(0, len(x), (2000, len(x)))].mean(axis=1)
        low, high = np.quantile(draws, [0.05, 0.95])
        out[key] = {"mean": float(x.mean()), "low": float(low), "high": float(high)}
        print(f"  {key:18s} {x.mean():7.3f}   [{low:.3f}, {high:.3f}]", flush=True)
    wins = float(np.mean([r["answer"] < r["nominal"] for r in rows]))
    out["answer_beats_nominal"] = {"mean": wins}
    print(f"  answer beats nominal for {wins:.0%} of robots")
    return out


def main() -> None:
    """Run the table; `--tune` uses the development robots."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--budget", type=int, default=None, help="default: that of the command")
    parser.add_argument("--registry", default="benchmarks/registry")
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--only", nargs="*", default=["in", "out"])
    parser.add_argument("--kinds", nargs="*", default=["shared", "own"])
    given = parser.parse_args()
    with dynreg.open(given.registry) as reg:
        summary = reg.populate("quadruped", given.entries)
        print(f"{summary.entries} entries ({summary.added} added in {summary.seconds:.0f} s)", flush=True)
        population = load_population(reg.registry, summary.population, states=True, judged=True)
        results = json.loads(FILE.read_text()) if FILE.exists() and not given.tune else {}
        for family in given.only:
            robots = hidden_robots(
                population.shared.robot, given.robots, TUNE if given.tune else REPORT, outside=family == "out"
            )
            for kind in given.kinds:
                rows = [measure(reg.registry, population, h, kind, given.budget) for h in robots]
                label = f"{'in' if family == 'in' else 'out of'} the family, {kind} commands"
                results[label] = table(rows, label)
                if not given.tune:
                    RESULTS.mkdir(exist_ok=True)
                    FILE.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
