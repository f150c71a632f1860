"""Three simulators of a wheeled robot compared as in the paper (Tables III and IV): how far off, and how quick.

Hidden robots have published parameters of the unicycle (Khepera III twice over, Laut's Khepera III, and two between
them), and each displacement is measured with noise that has the mean size of the errors which the paper's dynamic model
leaves: so its errors are like the published ones. For each: 1000 commands to fit, 230 to validate, 230 to test; the
closed form as it stands, the unicycle by the genetic algorithm, three networks by Levenberg and Marquardt's method.

Ratios of mean errors, and Tukey's p-values, beside the published ones; microseconds for a command, one by one and all
at once, in the same run.

Every finished robot is a line of the journal (`--journal`); a second start goes on.
"""

import argparse
import json
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from journal import Journal
from kept import RESULTS
from khepera_robots import CUT, PUBLISHED, TRACK, TRUTHS, log_of

from dynreg.results.comparison import Errors
from dynreg.rng import stream
from dynreg.timed.commands import AXES, drawn
from dynreg.timed.compare import compared
from dynreg.timed.fit import Breeding, fit_unicycle
from dynreg.timed.models import Kinematic, Model, Unicycle
from dynreg.timed.networks import Networks, train

FILE = RESULTS / "wheeled_models.json"
TUNE, REPORT = 62, 20261210
QUICK = {"network": 484.0, "dynamic": 16700.0, "kinematic": 24.0}  # ms for 100,000 commands, Table IV
NETWORK = ("weights", "mean", "scale", "out_mean", "out_scale", "errors")


@dataclass(frozen=True)
class Plan:
    """What makes it this table."""

    seed: int
    generations: int
    starts: int


def main() -> None:
    """Print both tables, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--generations", type=int, default=150)
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--robots", type=int, default=len(TRUTHS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--journal", type=Path, help="[benchmarks/results/wheeled_models.jsonl]")
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no table")
    given = parser.parse_args()
    plan = Plan(TUNE if given.tune else REPORT, given.generations, given.starts)
    path = given.journal or FILE.with_suffix(".jsonl")
    journal = Journal(path, {"plan": asdict(plan)})
    journal.begin()
    names = list(TRUTHS)[: given.robots]
    left = [name for name in names if name not in {row["robot"] for row in journal.lines()}]
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(work, plan, name, path) for name in left]):
            print(future.result(), flush=True)
    rows = {row["robot"]: row for row in journal.lines()}
    for name in names:
        _show(rows[name])
    figures = {
        "plan": asdict(plan),
        "errors": [rows[name] for name in names],
        "speed": _speed(rows[names[0]]),
    }
    if not given.tune:
        FILE.write_text(json.dumps(figures, indent=1) + "\n")


def work(plan: Plan, name: str, path: Path) -> str:
    """One hidden robot, on one core; its name and what it took."""
    number, truth = list(TRUTHS).index(name), TRUTHS[name]
    commands, moved = log_of(plan.seed, name)
    known, unseen, rest = ((commands.take(c), moved[c]) for c in CUT)
    began = time.process_time()
    fitted = fit_unicycle(*known, unseen, TRACK, Breeding(generations=plan.generations, seed=number))
    middle = time.process_time()
    networks = train(*known, unseen, starts=plan.starts, seed=number)
    seconds = (middle - began, time.process_time() - middle)
    models = _models(fitted.parameters, networks)
    found = compared(rest[1], {kind: model.predict(rest[0]) for kind, model in models.items()})
    kept = {field: getattr(networks, field).tolist() for field in NETWORK}
    row = {"robot": name, "truth": truth.tolist(), "found": fitted.parameters.tolist(), "networks": kept}
    Journal(path, {"plan": asdict(plan)}).add(row | {"core": seconds, "errors": asdict(found)})
    return f"{name}: unicycle fitted in {seconds[0]:.0f} core s, networks in {seconds[1]:.0f}"


def _models(parameters: np.ndarray, networks: Networks) -> dict[str, Model]:
    return {"kinematic": Kinematic(TRACK), "dynamic": Unicycle(parameters, TRACK), "network": networks}


def _show(row: dict) -> None:
    """Print one robot."""
    found = Errors.model_validate(row["errors"])
    print(
        f"\n{row['robot']}: a1 to a6 {np.round(row['truth'], 4).tolist()}, found {np.round(row['found'], 4).tolist()}"
    )
    mean = {kind: [axes[axis].mean for axis in AXES] for kind, axes in found.models.items()}
    for kind, errors in mean.items():
        print(f"  {kind:10s} {errors[0]:6.3f} cm {errors[1]:6.3f} cm {errors[2]:7.3f} deg")
    for kind in ("kinematic", "network"):
        ours = np.array(mean[kind]) / mean["dynamic"]
        theirs = np.array(PUBLISHED[kind]) / PUBLISHED["dynamic"]
        print(f"  {kind} / dynamic: {np.round(ours, 2)}, published {np.round(theirs, 2)}")
    for pair in found.pairs:
        print(
            f"  {pair.axis:7s} {pair.first:10s} {pair.second:10s} Tukey {pair.tukey:.3g} paired {pair.paired:.3g}"
        )


def models_of(row: dict) -> dict[str, Model]:
    """The models of a journal's line."""
    networks = Networks(**{field: np.array(values) for field, values in row["networks"].items()})
    return _models(np.array(row["found"]), networks)


def _speed(row: dict, many: int = 20_000, alone: int = 200) -> dict[str, dict[str, float]]:
    """Microseconds a command of a robot's models: all at once, and one by one."""
    models = models_of(row)
    commands = drawn(many, stream(0, "speed"))
    ones = [commands.take(slice(i, i + 1)) for i in range(alone)]
    out = {}
    for kind, model in models.items():
        together = 1e6 * _seconds(lambda m=model: m.predict(commands)) / many
        apart = 1e6 * _seconds(lambda m=model: [m.predict(c) for c in ones]) / alone
        out[kind] = {"together": together, "apart": apart}
    for kind, row in out.items():
        theirs = QUICK[kind] / QUICK["kinematic"]
        print(
            f"  {kind:10s} {row['together']:9.3f} us a command at once, {row['apart']:9.1f} us one by one"
            f" ({row['apart'] / row['together']:.0f} times); to the kinematic model"
            f" {row['together'] / out['kinematic']['together']:.1f} at once,"
            f" {row['apart'] / out['kinematic']['apart']:.1f} one by one, published {theirs:.1f}"
        )
    return out


def _seconds(do: Callable[[], object], times: int = 5) -> float:
    """The quickest of some runs."""
    took = []
    for _ in range(times):
        began = time.perf_counter()
        do()
        took.append(time.perf_counter() - began)
    return min(took)


if __name__ == "__main__":
    main()
