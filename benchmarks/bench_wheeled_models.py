"""Three simulators of a wheeled robot compared as in the paper (Tables III and IV): how far off, and how quick.

Hidden robots have published parameters of the unicycle (Khepera III twice over, Laut's Khepera III, and two between
them), and each displacement is measured with noise that has the mean size of the errors which the paper's dynamic model
leaves: so its errors are like the published ones. For each: 1000 commands to fit, 230 to validate, 230 to test; the
closed form as it stands, the unicycle by the genetic algorithm, three networks by Levenberg and Marquardt's method.

Ratios of mean errors, and Tukey's p-values, beside the published ones; microseconds for a command, one by one and all
at once, in the same run.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dynreg.results.comparison import Errors
from dynreg.rng import stream
from dynreg.timed.commands import AXES, drawn
from dynreg.timed.compare import FACTORS, compared
from dynreg.timed.fit import fit_unicycle
from dynreg.timed.models import Kinematic, Model, Unicycle
from dynreg.timed.networks import train
from dynreg.timed.unicycle import KHEPERA, LAUT, unicycle

FILE = Path(__file__).parent / "results" / "wheeled_models.json"
TUNE, REPORT = 62, 20261210
TRACK = 0.0884  # m
CUT = (slice(0, 1000), slice(1000, 1230), slice(1230, 1460))
TRUTHS = {
    "Table II": KHEPERA,
    "Table II again": KHEPERA,
    "Laut": LAUT,
    "half way": 0.5 * (KHEPERA + LAUT),
    "slower": KHEPERA * [1.3, 1.3, 1.0, 1.0, 1.0, 1.0],
}
# mean absolute errors, Table III: cm, cm, degrees
PUBLISHED = {
    "network": (0.4483, 0.6241, 3.0239),
    "dynamic": (0.3467, 0.3628, 4.1985),
    "kinematic": (1.0093, 1.2788, 13.2385),
}
QUICK = {"network": 484.0, "dynamic": 16700.0, "kinematic": 24.0}  # ms for 100,000 commands, Table IV
NOISE = (
    np.array(PUBLISHED["dynamic"]) / FACTORS * np.sqrt(np.pi / 2)
)  # 1 sigma, of that mean size [m, m, rad]


def main() -> None:
    """Print both tables, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--generations", type=int, default=300)
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--robots", type=int, default=len(TRUTHS))
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robots = list(TRUTHS.items())[: given.robots]
    figures = {"errors": [_robot(n, *robot, seed, given) for n, robot in enumerate(robots)]}
    figures["speed"] = _speed(figures["errors"][0].pop("models"))
    for row in figures["errors"]:
        row.pop("models", None)
    if not given.tune:
        FILE.write_text(json.dumps(figures, indent=1) + "\n")


def _robot(number: int, name: str, truth: np.ndarray, seed: int, given: argparse.Namespace) -> dict:
    commands = drawn(CUT[-1].stop, stream(seed, "commands", number))
    moved = unicycle(commands, truth, TRACK)
    moved += NOISE * stream(seed, "tracker", number).standard_normal(moved.shape)
    known, unseen, rest = ((commands.take(c), moved[c]) for c in CUT)
    began = time.perf_counter()
    fitted = fit_unicycle(*known, unseen, TRACK, generations=given.generations, seed=number)
    middle = time.perf_counter()
    models: dict[str, Model] = {
        "kinematic": Kinematic(TRACK),
        "dynamic": Unicycle(fitted.parameters, TRACK),
        "network": train(*known, unseen, starts=given.starts, seed=number),
    }
    end = time.perf_counter()
    found = compared(rest[1], {kind: model.predict(rest[0]) for kind, model in models.items()})
    print(f"\n{name}: unicycle fitted in {middle - began:.0f} s, networks in {end - middle:.0f} s")
    print("  a1 to a6", np.round(truth, 4).tolist(), "found", np.round(fitted.parameters, 4).tolist())
    _show(found)
    return {"robot": name, "found": fitted.parameters.tolist(), **found.to_dict(), "models": models}


def _show(found: Errors) -> None:
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


def _speed(models: dict[str, Model], many: int = 20_000, alone: int = 200) -> dict[str, dict[str, float]]:
    """Microseconds a command: all at once, and one by one."""
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
