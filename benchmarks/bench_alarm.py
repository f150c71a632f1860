"""How often the alarm of `dynreg query` rings: for robots of the family, and for those that hide a cause outside it.

Each robot is drawn twice, with the same parameters (uniform over nine tenths of their ranges), commands and seeds: as a
robot of the family, and with one effect of the library hidden in it (any that the robot can have, of medium or strong
size). The truth runs with a finer time step and another integrator, is disturbed, and is read by noisy, quantised
sensors. A query of a population of 200 simulators with its usual settings answers both logs.

What a cause does to the held-out error of the best in the family: the best for the robot with the cause is the better
of the answer and, where it is not clear, of a search with twice the budget and twice the neighbours; for the one
without it, the better of the answer and the true parameters. Both errors are in the same units. Parameters of the
family make up for many causes; those are no ground for an alarm.

Robots for reporting have seeds of their own (`REPORT`), apart from those by which the alarm's limits were chosen.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from hidden import rows_of
from journal import Journal
from kept import RESULTS
from scipy.stats import binomtest

import dynreg
from dynreg.data.recording import Recording
from dynreg.evidence.truth import Hidden, Protocol, hide, log_of, protocol
from dynreg.neighbours.spending import usual_budget
from dynreg.replay.data import data
from dynreg.replay.windows import Replayer, Windows, errors
from dynreg.results import Neighbours
from dynreg.rng import stream
from dynreg.sim.effects import applicable, placed
from dynreg.sim.robot import Robot

FILE = RESULTS / "alarm.json"
TUNE, REPORT = 71, 20261125
ROBOTS = {"servo_pendulum": 80, "diffdrive": 80, "leg": 16, "quadruped": 8}
SIMULATORS = 200
SECONDS, EPISODE = 25.0, 2.5
EDGE = 0.05  # of a range at each end, from which no truth is drawn
DOUBLED = 2.0  # times the held-out error of the best in the family, from which on an alarm is asked for
CLEARLY = (
    5.0  # times that error, from which on twice the budget cannot bring it below that: not searched again
)
ABSORBED = 1.2  # times that error, below which the family makes up for the cause
K = 5


def drawn(robot: Robot, seed: int) -> tuple[Hidden, Hidden]:
    """A robot of the family, and the same one with a cause."""
    rng = stream(seed, "alarm", robot.name)
    parameters = robot.space.from_unit(rng.uniform(EDGE, 1.0 - EDGE, len(robot.space)))
    effect = rng.choice(sorted(applicable(robot)))
    terms = placed(robot, applicable(robot)[effect])
    term, size = terms[rng.integers(len(terms))], ("medium", "strong")[rng.integers(2)]
    return Hidden((), (), parameters, seed), replace(hide(robot, (term,), size, seed), parameters=parameters)


def cut_of(robot: Robot, log: Recording) -> tuple[Windows, np.ndarray]:
    """The windows of a log, and which of them are held out by a query."""
    found = data(robot, log)
    return found.windows, np.flatnonzero(found.parts.test)


def held_out(robot: Robot, log: Recording, units: Windows, *values: np.ndarray) -> float:
    """The least error of simulators (P,) on the held-out windows of a log, in the units of the errors of others."""
    windows, test = cut_of(robot, log)
    replayer = Replayer(robot, replace(windows, spread=units.spread, weight=units.weight), 1)
    return float(errors(replayer.residuals(np.array(values), test)).mean(axis=1).min())


def row(session: "dynreg.Session", robot: Robot, seed: int, population: str) -> dict:
    """What the alarm says of a robot without and with its cause, and what the cause does to the held-out error."""
    plan = protocol(robot, seed=seed, seconds=SECONDS, episode=EPISODE)
    plain, caused = drawn(robot, seed)
    logs = [_log(robot, hidden, plan) for hidden in (plain, caused)]
    answers, out = [], {"robot": robot.name, "seed": seed, "cause": caused.key, "size": caused.size}
    for kind, log in zip(("without", "with"), logs, strict=True):
        session.ingest(log, robot, name=f"{robot.name} {seed} {kind}")
        began = time.perf_counter()
        answer = session.query(f"{robot.name} {seed} {kind}", population=population, k=K, threads=1)
        answers.append(answer)
        out[kind] = {
            "fits": answer.fits,
            "misfit": answer.misfit,
            "limit": answer.misfit_limit,
            "seconds": time.perf_counter() - began,
        }
    units, _ = cut_of(robot, logs[0])
    out["error_without"] = held_out(robot, logs[0], units, _values(robot, answers[0]), plain.parameters)
    error = held_out(robot, logs[1], units, _values(robot, answers[1]))
    if DOUBLED <= error / out["error_without"] < CLEARLY:  # below, a better one doubles nothing either
        budget = 2 * usual_budget(robot, 2 * K)
        generous = session.query(
            f"{robot.name} {seed} with", population=population, k=2 * K, budget=budget, threads=1
        )
        error = min(error, held_out(robot, logs[1], units, _values(robot, generous)))
    out["error_with"] = error
    return out


def _log(robot: Robot, hidden: Hidden, plan: Protocol) -> Recording:
    return log_of(robot, hidden, plan, engine="mujoco" if "mujoco" in robot.engines else None)


def _values(robot: Robot, answer: Neighbours) -> np.ndarray:
    return robot.space.from_dict(answer.answer_parameters)


def told(name: str, found: list[dict]) -> dict:
    """Print and return the table of a robot: how often the alarm rings, by what the cause does."""
    times = np.array([one["error_with"] / one["error_without"] for one in found])
    rings = np.array([not one["with"]["fits"] for one in found])
    table = {
        "robots of the family": np.array([not one["without"]["fits"] for one in found]),
        "a cause that doubles the error": rings[times >= DOUBLED],
        f"a cause of {ABSORBED:g} to {DOUBLED:g} times": rings[(times >= ABSORBED) & (times < DOUBLED)],
        "a cause that the family makes up for": rings[times < ABSORBED],
    }
    print(f"\n{name}: {len(found)} robots, each without and with a cause")
    out = {}
    for which, alarms in table.items():
        if not len(alarms):
            continue
        low, high = binomtest(int(alarms.sum()), len(alarms)).proportion_ci(0.95)
        out[which] = {"alarms": int(alarms.sum()), "of": len(alarms), "low": low, "high": high}
        print(
            f"  {which:38s} {alarms.sum():3d} alarms of {len(alarms):3d}: {alarms.mean():.2f} [{low:.2f}, {high:.2f}]"
        )
    misfit = np.array([one["without"]["misfit"] for one in found])
    limit = np.array([one["without"]["limit"] for one in found])
    out["misfit of the family"] = {"median": float(np.median(misfit)), "most": float(misfit.max())}
    out["limit"] = {"median": float(np.median(limit)), "most": float(limit.max())}
    out["seconds"] = float(np.median([one["without"]["seconds"] for one in found]))
    print(
        f"  misfit of robots of the family: median {np.median(misfit):.2f}, most {misfit.max():.2f}; limit: median "
        f"{np.median(limit):.2f}, most {limit.max():.2f}; {out['seconds']:.1f} s a query"
    )
    return out


def main() -> None:
    """Run the table; `--tune` uses the development robots and writes no result."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--robots", type=int, help="of each kind, in place of the usual number")
    parser.add_argument("--only", default=",".join(ROBOTS))
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--journal", default=str(Path(__file__).parent / "registry" / "alarm.jsonl"))
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    for name in given.only.split(","):
        head = {"robot": name, "seed": seed, "version": 1}
        journal = Journal(Path(given.journal).with_suffix(f".{name}.{seed}.jsonl"), head)
        journal.begin()
        found = told(name, rows_of(name, seed, given.robots or ROBOTS[name], SIMULATORS, journal, row))
        if not given.tune:
            results = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
            FILE.write_text(json.dumps(results | {name: found}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
