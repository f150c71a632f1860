"""How many generations the genetic algorithm for a1 to a6 needs (paper A): ours, the paper's 1,000, and the minimum.

First the fits of `bench_wheeled_models.py` (150 generations, 1000 commands, five hidden robots) beside the minimum of
the same cost, which least squares finds: no number of generations gets below it. Then, on commands that are fewer and
shorter (100 of up to 0.6 s, for 1,000 generations of 1000 commands of up to 2 s take half an hour), both numbers of
generations on some of these robots, from the same seed.

A cost is the mean over commands of the squared errors of the three displacements, each over its variance; test errors
are mean absolute ones on 230 commands, in cm, cm and degrees.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from kept import RESULTS
from khepera_robots import CUT, NOISE, TRACK, TRUTHS, log_of
from wheeled_robots import fitted

from dynreg.rng import stream
from dynreg.timed.commands import Commands, drawn
from dynreg.timed.compare import FACTORS
from dynreg.timed.fit import Breeding, fit_unicycle
from dynreg.timed.unicycle import unicycle

TUNE, REPORT = 66, 20261231
PARTS = (slice(0, 100), slice(100, 150), slice(150, 380))
LONGEST = 0.6  # s of a command
STEP = 0.02  # s, as the genetic algorithm has


def cost(commands: Commands, moved: np.ndarray, parameters: np.ndarray) -> float:
    """What the genetic algorithm minimises."""
    found = unicycle(commands, parameters, TRACK, step=STEP)
    return float(((found - moved) ** 2 / moved.var(axis=0)).sum(axis=1).mean())


def errors(commands: Commands, moved: np.ndarray, parameters: np.ndarray) -> list[float]:
    """Mean absolute errors of the three displacements, in cm, cm and degrees."""
    return (np.abs(unicycle(commands, parameters, TRACK) - moved).mean(axis=0) * FACTORS).tolist()


def judged(
    commands: Commands, moved: np.ndarray, parts: tuple[slice, ...], fits: dict[str, np.ndarray]
) -> dict:
    """Cost on the first part and errors on the last of fits {name: (6,)}, and the fits."""
    known, rest = ((commands.take(part), moved[part]) for part in (parts[0], parts[-1]))
    return {
        name: {"cost": cost(*known, p), "errors": errors(*rest, p), "parameters": p.tolist()}
        for name, p in fits.items()
    }


def kept(row: dict, seed: int) -> dict:
    """A fit of `bench_wheeled_models.py` beside the minimum."""
    commands, moved = log_of(seed, row["robot"])
    least = fitted(commands.take(CUT[0]), moved[CUT[0]], TRACK)
    return judged(commands, moved, CUT, {"genetic": np.array(row["found"]), "least squares": least})


def bred(name: str, seed: int, generations: tuple[int, ...]) -> dict:
    """Fits after so many generations beside the minimum, on fewer and shorter commands."""
    number = list(TRUTHS).index(name)
    commands = drawn(PARTS[-1].stop, stream(seed, "commands", number), seconds=(0.1, LONGEST))
    moved = unicycle(commands, TRUTHS[name], TRACK)
    moved += NOISE * LONGEST / 2.0 * stream(seed, "tracker", number).standard_normal(moved.shape)
    known, unseen, _ = ((commands.take(part), moved[part]) for part in PARTS)
    fits = {"least squares": fitted(*known, TRACK)}
    for count in generations:
        began = time.process_time()
        breeding = Breeding(generations=count, seed=number)
        fits[f"{count} generations"] = fit_unicycle(*known, unseen, TRACK, breeding).parameters
        print(f"{name}: {count} generations in {time.process_time() - began:.0f} core s", flush=True)
    return judged(commands, moved, PARTS, fits)


def show(name: str, found: dict) -> None:
    """Print one robot."""
    print(name)
    for fit, row in found.items():
        off = ", ".join(f"{e:.3f}" for e in row["errors"])
        print(f"  {fit:18s} cost {row['cost']:.5f}; test errors {off}", flush=True)


def main() -> None:
    """Print both tables, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", type=Path, default=RESULTS / "wheeled_models.jsonl", help="the kept fits")
    parser.add_argument("--generations", nargs="*", type=int, default=[150, 1000])
    parser.add_argument("--robots", nargs="*", choices=TRUTHS, default=["Table II", "Laut", "slower"])
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    given = parser.parse_args()
    head, *rows = map(json.loads, given.models.read_text(encoding="utf-8").splitlines())
    out: dict[str, dict] = {"kept": {}, "bred": {}}
    for row in rows:
        out["kept"][row["robot"]] = kept(row, head["plan"]["seed"])
        show(f"{row['robot']}, {head['plan']['generations']} generations", out["kept"][row["robot"]])
    for name in given.robots:
        out["bred"][name] = bred(name, TUNE if given.tune else REPORT, tuple(given.generations))
        show(name, out["bred"][name])
    if not given.tune:
        (RESULTS / "wheeled_ga.json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
