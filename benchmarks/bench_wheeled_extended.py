"""Robots on two wheels that hide an effect: the diagnosed and extended simulator beside models that learn.

Each hides one effect of strong size in nameplate errors, noise and a disturbance, and is told random wheel speeds, one
command after the other: 20 minutes, about 1100 commands. The first two thirds of the episodes are what models are
fitted to and what the diagnosis sees; the last commands test them all (`dynreg compare`): mean errors of the
displacements by axis, with Wilcoxon's signed ranks between the extended simulator and the others (Holm).
"""

import argparse
import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
from kept import RESULTS

import dynreg
from dynreg.evidence.truth import Protocol, hide, log_of
from dynreg.results import Comparison
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

FILE = RESULTS / "wheeled_extended.json"
TUNE, REPORT = 64, 20261213
EFFECTS = ("wheel_gain", "turn_slowdown", "command_deadband", "command_delay", "wheel_slip")
EPISODES, SECONDS = 20, 60.0
SPEED, HELD = 0.22, (0.1, 2.0)  # m/s, s
TEST = 0.2  # of the episodes, at the end: no less than the last 16 % of commands, which judge
RIVALS = ("kinematic", "dynamic", "network")


def protocol_of(robot: Robot, seed: int) -> Protocol:
    """Wheel speeds held for random times, rounded to the robot's period."""
    rng, steps = stream(seed, "held commands"), round(SECONDS * robot.rate)
    actions = np.empty((EPISODES, steps, 2))
    for episode in actions:
        at = 0
        while at < steps:
            rows = max(round(rng.uniform(*HELD) * robot.rate), 1)
            episode[at : at + rows] = rng.uniform(-SPEED, SPEED, 2) / robot.file.base.wheel_radius
            at += rows
    run = Run(actions, period=1.0 / robot.rate, begin=np.arange(EPISODES) * (steps + 1) / robot.rate)
    return Protocol(run, tuple(f"drive_{i:02d}" for i in range(EPISODES)))


def compared(robot: Robot, effect: str, seed: int, given: argparse.Namespace) -> dict:
    """One hidden robot: diagnosed, and compared."""
    own = stream_seed(seed, "extended", effect) % 2**31
    plan = protocol_of(robot, own)
    log = log_of(robot, hide(robot, (term(effect),), given.size, own), plan, engine="unicycle")
    test = plan.names[-round(TEST * EPISODES) :]
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        reg.registry.put_robot(robot.folder, robot.hash, robot.name)
        identity = reg.registry.put_recording(log, robot.hash)
        began = time.perf_counter()
        found = reg.diagnose(
            identity, hold_out=",".join(test), threshold_runs=given.threshold_runs, threads=given.threads
        )
        middle = time.perf_counter()
        table = reg.compare(
            identity,
            models=RIVALS,
            simulators=("diagnosed",),
            starts=given.starts,
            generations=given.generations,
            threads=given.threads,
        )
    seconds = (middle - began, time.perf_counter() - middle)
    return {"effect": effect, **_told(found), **_scores(table), "seconds": seconds}


def _told(found) -> dict:
    return {
        "verdict": found.verdict,
        "causes": [[c.key, {k: v.value for k, v in c.parameters.items()}] for c in found.causes],
    }


def _scores(table: Comparison) -> dict:
    """Mean errors {name: {axis: ...}}, and p-values of the extended simulator against each rival."""
    table = table.commands
    extended = next(name for name in table.names if name not in RIVALS)
    short = {extended: "extended"} | {name: name for name in RIVALS}
    means = {short[n]: {a: s.mean for a, s in axes.items()} for n, axes in table.errors.models.items()}
    pairs = [p for p in table.errors.pairs if extended in (p.first, p.second)]
    chances = {f"{short[p.second if p.first == extended else p.first]} {p.axis}": p.paired for p in pairs}
    wins = all(means["extended"][a] < means[n][a] for n in RIVALS[1:] for a in table.axes)
    return {"commands": table.errors.commands, "means": means, "paired": chances, "beats both": wins}


def show(row: dict) -> None:
    """Print one robot."""
    sizes = "; ".join(f"{k} {', '.join(f'{n} {v:.4g}' for n, v in p.items())}" for k, p in row["causes"])
    diagnosed, made = row["seconds"]
    print(
        f"\n{row['effect']}: {row['verdict']}: {sizes or 'nothing'} ({diagnosed:.0f} s, models {made:.0f} s)"
    )
    for name, axes in row["means"].items():
        chances = [row["paired"].get(f"{name} {a}") for a in axes]
        beside = "" if name == "extended" else "  p " + " ".join(f"{c:.2g}" for c in chances)
        print(f"  {name:10s}" + "".join(f" {v:7.3f}" for v in axes.values()) + beside)
    print(
        f"  extended beats dynamic and network on every axis: {'yes' if row['beats both'] else 'NO'}",
        flush=True,
    )


def main() -> None:
    """Print the tables and write benchmarks/results/wheeled_extended.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--effects", nargs="*", default=EFFECTS)
    parser.add_argument("--size", default="strong")
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--generations", type=int, default=100)
    parser.add_argument("--threshold-runs", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--threads", type=int, default=1, help="of each process")
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    given = parser.parse_args()
    job = partial(compared, load_robot("diffdrive"), seed=TUNE if given.tune else REPORT, given=given)
    rows = []
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        for row in pool.map(job, given.effects):
            rows.append(row)
            show(row)
    if not given.tune:
        FILE.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
