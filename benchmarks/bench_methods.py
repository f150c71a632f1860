"""Every method of `dynreg calibrate` on the same hidden robots: one question, one table.

Robots of the family, whose parameters differ from the nameplate, and robots with a cause that the family lacks. Replay
error on what was held out, as a share of the nominal simulator's (median over robots, and each), simulators that were
run, and core seconds. Reporting robots were never used in development (`REPORT`).
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from journal import Journal
from naming import RESULTS, TUNE

import dynreg
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.methods.table import METHODS
from dynreg.rng import stream_seed
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

REPORT = 20261201
HIDDEN = ("in the family", "outside")
OUTSIDE = {"servo_pendulum": "load_friction", "quadruped": "load_friction", "diffdrive": "turn_slowdown"}
PLANS = {  # of `staged`: the drives first, then all
    "servo_pendulum": (("*_friction", "torque_constant", "resistance"), ("*",)),
    "quadruped": (("torque", "motor_speed"), ("*",)),
    "diffdrive": (("*",),),
}
ENTRIES = {"servo_pendulum": 300, "quadruped": 200, "diffdrive": 300}
SIZE = "medium"
OF_RECORDINGS = [name for name, kind in METHODS.items() if not kind.tries]


def plan(folder: Path, robot: str) -> Path:
    """The file of a plan: the first stage for single joints where there are any, the last for whole replays."""
    space = load_robot(robot).space.names
    stages = []
    for number, patterns in enumerate(PLANS[robot]):
        own = [p for p in patterns if "*" in p or p in space]
        loss = "joint" if number == 0 and len(PLANS[robot]) > 1 else "replay"
        stages.append(
            f'[[stages]]\nname = "s{number}"\nparameters = {json.dumps(own)}\nloss = "{loss}"\ngenerations = 10\n'
        )
    path = folder / f"{robot}.toml"
    path.write_text("\n".join(stages), encoding="utf-8")
    return path


def cell(session: dynreg.Session, name: str, robot: str, method: str, given: argparse.Namespace) -> dict:
    """What a method answers about a registered recording."""
    folder = Path(session.registry.path)
    told = {"plan": plan(folder, robot)} if method == "staged" else {}
    found = session.calibrate(name, method=method, hold_out="test_0", threads=given.threads, seed=1, **told)
    return {
        "share": found.test_error / found.nominal_test_error,
        "rollouts": found.cost.rollouts,
        "core seconds": found.cost.core_seconds,
        "versions": [one.stage for one in found.versions],
        "ended": found.ended,
    }


def main() -> None:
    """Print the table; that of the reporting robots is kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=["servo_pendulum", "quadruped"], choices=list(PLANS))
    parser.add_argument("--methods", nargs="*", default=OF_RECORDINGS, choices=OF_RECORDINGS)
    parser.add_argument("--robots", type=int, default=3, help="of each kind, in the family and outside")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--journal", type=Path, default=RESULTS / "methods.jsonl")
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no table")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    journal = Journal(given.journal, {"seed": seed})
    journal.begin()
    done = {(x["robot"], x["hidden"], x["number"], x["method"]) for x in journal.lines()}
    for name in given.only:
        robot = load_robot(name)
        with tempfile.TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:
            session.populate(robot, ENTRIES[name], seed=seed, threads=given.threads)
            for hidden in HIDDEN:
                causes = (OUTSIDE[name],) if hidden == "outside" else ()
                for number in range(given.robots):
                    own = stream_seed(seed, "methods", name, hidden, number) % 2**31
                    truth = hide(robot, tuple(term(c) for c in causes), SIZE if causes else None, own)
                    log = log_of(robot, truth, protocol(robot, seed=own), engine=next(iter(robot.engines)))
                    called = f"{name}_{hidden}_{number}".replace(" ", "_")
                    session.ingest(log, robot, name=called)
                    for method in given.methods:
                        if "wheels" in METHODS[method].needs and not robot.planar:
                            continue
                        if (name, hidden, number, method) in done:
                            continue
                        found = cell(session, called, name, method, given)
                        line = {"robot": name, "hidden": hidden, "number": number, "method": method, **found}
                        journal.add(line)
                        print(json.dumps(line), flush=True)
    show(journal.lines())
    if not given.tune:
        kept = {"seed": seed, "cells": journal.lines()}
        (RESULTS / "methods.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def show(lines: list[dict]) -> None:
    """Print the table."""
    for robot in dict.fromkeys(x["robot"] for x in lines):
        for hidden in HIDDEN:
            print(f"{robot}, {hidden}")
            for method in METHODS:
                own = [x for x in lines if (x["robot"], x["hidden"], x["method"]) == (robot, hidden, method)]
                if own:
                    share, runs, spent = (
                        float(np.median([x[k] for x in own])) for k in ("share", "rollouts", "core seconds")
                    )
                    each = " ".join(f"{x['share']:.2f}" for x in own)
                    print(
                        f"  {method:10} {share:6.3f}  ({each})  {runs:7.0f} simulators  {spent:7.1f} core s"
                    )


if __name__ == "__main__":
    main()
