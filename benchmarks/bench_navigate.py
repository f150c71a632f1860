"""Whether the simulated drives of `dynreg navigate` tell where a robot ends that plays its plan.

Hidden robots: a diffdrive with errors of its nameplate, on the unicycle engine, which the kinematic model is not. Each
has a log of eight runs of 30 s. A model is made from it, plans to places that are drawn are sought in the model, and
the robot plays each once. Told is in how many the robot's end lies in the middle 90 % of the drives, or nearer to where
it should be, and how many drives visit all places beside how many robots did. A result is kept at the usual size only.
"""

import argparse
import json

import numpy as np
from kept import RESULTS
from scipy.stats import binomtest

from dynreg.evidence.interval import NINETY
from dynreg.evidence.truth import Hidden, Protocol, hide, log_of
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.timed.navigation import short, visited
from dynreg.verbs.navigate_settings import NavigateSettings
from dynreg.verbs.navigation import Planned, planned

FILE = RESULTS / "navigate.json"
TUNE, REPORT = 20261101, 20270104
ROBOTS, GENERATIONS = 12, 150  # the usual size, of which alone a result is kept
SPEED = 0.22  # m/s, of the fastest wheel
RUNS, HELD = 8, (0.5, 2.0)  # runs of 30 s, and for how long a pair of speeds holds [s]


def driven_at_random(robot: Robot, seed: int) -> Protocol:
    """Random wheel speeds, each pair held for a time."""
    rng, fastest = stream(seed, "drives"), SPEED / robot.file.base.wheel_radius
    period = 1.0 / robot.file.robot.control_rate
    steps = round(30.0 / period)
    told = []
    for _ in range(RUNS):
        held = (rng.uniform(*HELD, 60) / period).round().astype(int)
        told.append(np.repeat(rng.uniform(-fastest, fastest, (60, 2)), held, axis=0)[:steps])
    run = Run(np.stack(told), period=period, begin=30.0 * np.arange(RUNS))
    return Protocol(run, tuple(f"run_{i}" for i in range(RUNS)))


def played(robot: Robot, hidden: Hidden, found: Planned) -> np.ndarray:
    """(T, 2) where the hidden robot is that plays a plan."""
    told = found.values.repeat(found.plan.ticks[0], axis=0)
    trial = Protocol(Run(told[None], period=found.plan.tick, begin=np.zeros(1)), ("trial",))
    log = log_of(robot, hidden, trial, engine="unicycle")
    return log.episodes[0].values[:, log.columns(["base/x", "base/y"])]


def tried(robot: Robot, number: int, on: str, seed: int, generations: int) -> dict:
    """One plan on one robot."""
    rng = stream(seed, "places", number)
    places = rng.uniform(-0.6, 0.6, (1 + number % 3, 2))
    hidden = hide(robot, (), "medium", seed=seed + number)
    log = log_of(robot, hidden, driven_at_random(robot, seed + number), engine="unicycle")
    told = {"generations": generations, "seed": number, "threads": 1}
    settings = NavigateSettings(visit=places, back=number % 2 == 0, on=on, **told)
    found = planned(robot, log, settings)
    way, course = played(robot, hidden, found), found.course
    off = float(np.linalg.norm(course.ends - way[-1], axis=1).min())
    low, high = map(float, np.quantile(short(found.drives, course), NINETY))
    inside = (np.abs(way[:, None] - course.centres) <= course.side / 2).all(axis=2).any(axis=0)
    return {
        "robot": off,
        "low": low,
        "high": high,
        "visits": bool(inside.all()),
        "in the model": bool(visited(found.alone, course).all()),
        "drives": float(visited(found.drives, course).all(axis=1).mean()),
    }


def main() -> None:
    """Try the plans, print, and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=ROBOTS)
    parser.add_argument("--generations", type=int, default=GENERATIONS)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no result")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robot, out = load_robot("diffdrive"), {"given": vars(given) | {"seed": seed}}
    for on in ("kinematic", "dynamic"):
        rows = [tried(robot, number, on, seed, given.generations) for number in range(given.robots)]
        within = sum(r["low"] <= r["robot"] <= r["high"] for r in rows)
        nearer = sum(r["robot"] < r["low"] for r in rows)
        share = binomtest(within, len(rows)).proportion_ci(0.9)
        told = [r for r in rows if r["in the model"]]
        visits, drives = sum(r["visits"] for r in told), sum(r["drives"] for r in told)
        out[on] = {"within": within, "nearer": nearer, "visits": visits, "drives": drives, "plans": rows}
        print(
            f"{on:10s} the robot ends in the middle 90 % of the drives in {within} of {len(rows)}"
            f" [{share.low:.2f}, {share.high:.2f}], nearer in {nearer}; of {len(told)} plans that visit all in the"
            f" model {visits} do on the robot, by the drives {drives:.1f}",
            flush=True,
        )
    if not given.tune and (given.robots, given.generations) == (ROBOTS, GENERATIONS):
        FILE.write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
