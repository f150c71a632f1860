"""How often the intervals of `dynreg query` hold the true parameter, on hidden robots of which nobody has drawn before.

The truth runs with a finer time step and another integrator, is disturbed, and is read by noisy, quantised sensors; its
parameters are drawn uniformly over nine tenths of their ranges. A query of a population of 200 simulators with its
usual settings gives every parameter a 90 % interval. Reported for each robot: the share of parameters that lie in
theirs, how wide these are as a share of the range, and how many are the whole range, which holds any value.

Robots for reporting have seeds of their own (`REPORT`), apart from those by which the intervals were made.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from hidden import rows_of
from journal import Journal
from kept import RESULTS
from scipy.stats import binomtest

import dynreg
from dynreg.evidence.truth import Hidden, log_of, protocol
from dynreg.results import Neighbours
from dynreg.rng import stream
from dynreg.sim.robot import Robot

FILE = RESULTS / "query_intervals.json"
TUNE, REPORT = 71, 20261123
ROBOTS = ("servo_pendulum", "leg")
SIMULATORS = 200
SECONDS, EPISODE = 25.0, 2.5
EDGE = 0.05  # of a range at each end, from which no truth is drawn
WHOLE = 0.999  # share of its range from which on an interval is the whole of it


def hidden(robot: Robot, seed: int) -> Hidden:
    """A robot with parameters from nine tenths of their ranges."""
    unit = stream(seed, "intervals", robot.name).uniform(EDGE, 1.0 - EDGE, len(robot.space))
    return Hidden((), (), robot.space.from_unit(unit), seed)


def asked(session: "dynreg.Session", robot: Robot, truth: Hidden, population: str) -> Neighbours:
    """The answer to the log of a hidden robot."""
    plan = protocol(robot, seed=truth.seed, seconds=SECONDS, episode=EPISODE)
    engine = "mujoco" if "mujoco" in robot.engines else None
    name = f"{robot.name} {truth.seed}"
    session.ingest(log_of(robot, truth, plan, engine=engine), robot, name=name)
    return session.query(name, population=population, threads=1)


def row(robot: Robot, truth: Hidden, answer: Neighbours, seconds: float) -> dict:
    """Each parameter that was identified: whether its interval holds the truth, and its width [share of the range]."""
    space, said = robot.space, answer.synthesised.parameters
    low, true, high = (
        space.to_unit(space.from_dict(values)[None])[0]
        for values in (
            {name: one.low for name, one in said.items()},
            space.as_dict(truth.parameters),
            {name: one.high for name, one in said.items()},
        )
    )
    free = [not parameter.known for parameter in space.parameters]
    return {
        "robot": robot.name,
        "seed": truth.seed,
        "seconds": seconds,
        "fits": answer.fits,
        "parameters": {
            name: [bool(a <= t <= b), float(b - a)]
            for name, a, t, b, is_free in zip(space.names, low, true, high, free, strict=True)
            if is_free
        },
    }


def timed_row(session: "dynreg.Session", robot: Robot, seed: int, population: str) -> dict:
    """The row of the robot of a seed, with the seconds that its query took."""
    truth, began = hidden(robot, seed), time.perf_counter()
    answer = asked(session, robot, truth, population)
    return row(robot, truth, answer, time.perf_counter() - began)


def told(name: str, found: list[dict]) -> dict:
    """Print and return the table of a robot."""
    out = {}
    held = np.array([[p[0] for p in one["parameters"].values()] for one in found])
    width = np.array([[p[1] for p in one["parameters"].values()] for one in found])
    print(f"\n{name}: {len(found)} hidden robots, {sum(one['fits'] for one in found)} of them said to fit")
    print(f"  {'':24s} {'held':>5s} {'median width':>13s} {'whole range':>12s}")
    for p, parameter in enumerate(found[0]["parameters"]):
        out[parameter] = {
            "held": float(held[:, p].mean()),
            "width": float(np.median(width[:, p])),
            "whole": float((width[:, p] > WHOLE).mean()),
        }
        print(f"  {parameter:24s} {held[:, p].mean():5.2f} {np.median(width[:, p]):13.2f} "
              f"{(width[:, p] > WHOLE).mean():12.2f}")  # fmt: skip
    narrow = width <= WHOLE
    for which, chosen in (("all", held.ravel()), ("narrower than the range", held[narrow])):
        low, high = binomtest(int(chosen.sum()), len(chosen)).proportion_ci(0.95)
        out[which] = {"held": float(chosen.mean()), "low": low, "high": high, "of": len(chosen)}
        print(f"  {which}: {chosen.mean():.3f} [{low:.3f}, {high:.3f}] of {len(chosen)} intervals")
    return out


def main() -> None:
    """Run the table; `--tune` uses the development robots and writes no result."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--robots", type=int, default=32)
    parser.add_argument("--only", default=",".join(ROBOTS))
    parser.add_argument("--tune", action="store_true")
    parser.add_argument(
        "--journal", default=str(Path(__file__).parent / "registry" / "query_intervals.jsonl")
    )
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    results = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    for name in given.only.split(","):
        head = {"robot": name, "seed": seed, "version": 1}
        journal = Journal(Path(given.journal).with_suffix(f".{name}.{seed}.jsonl"), head)
        journal.begin()
        results[name] = told(name, rows_of(name, seed, given.robots, SIMULATORS, journal, timed_row))
    if not given.tune:
        FILE.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
