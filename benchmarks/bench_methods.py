"""Every method on the same hidden robots: one question, one table.

Of each robot some are in the family (their parameters differ from the nameplate) and some are outside it (they hide a
cause besides, each another one). The servo and the wheels are simulated by code that shares nothing with the library;
the quadruped by the library's own. Each method gets the same log, of so many seconds of the robot, and its error is
the replay error on what was held out, as a share of the nominal simulator's. `the robot itself` has the true
parameters and, where the library has it, the true cause: what noise leaves. `mujoco.sysid` fits all parameters.

`--only quadruped aibo` asks about robots on feet (`methods_robots`). Of the first `--walks` quadrupeds of each kind a
gait is sought in every answer and tried on the robot (`methods_walk`), and `btr` is asked, too: 190 trials, a share of
the published simulations.
There `diagnose` takes the threshold that `bench_naming_quadruped` found, and names one cause. `--episodes 1 10 30` asks
what so many episodes of a servo's log are worth: the same are held out for all (`methods_pictures` draws it).

Intervals of medians are of 90 %, bootstrap over robots. Each method is held against the one with the lowest median by
Wilcoxon's test on pairs of robots, with Holm's correction. Reporting robots were never used in development (`REPORT`).
"""

import argparse
import contextlib
import io
import json
import logging
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from journal import Journal
from kept import RESULTS, keep
from methods_robots import FEET, HIDDEN, PLANS, SIZE, Secret, described, plan, secrets
from methods_table import TRUE, show
from methods_walk import SEARCHES, Walks
from naming import TUNE
from reality_runs import scaled

import dynreg
from dynreg.diagnose.threshold import USUAL
from dynreg.diagnose.trial import right_names
from dynreg.errors import DynregError
from dynreg.evidence.truth import Hidden
from dynreg.methods.judged import replay_errors
from dynreg.methods.table import METHODS
from dynreg.replay.data import Data, data
from dynreg.replay.windows import Replayer
from dynreg.sim.config import SimConfig, effects_of
from dynreg.sim.effects import Terms
from dynreg.sim.real import finer
from dynreg.sim.robot import Robot

REPORT = 20261203
ENTRIES = {"servo_pendulum": 300, "quadruped": 200, "diffdrive": 300, "aibo": 0}
BUDGET = {"aibo": 200}  # simulations of a search; else its usual number
SCALE = 0.1  # of the generations of btr
NATS = {"quadruped": 100.4}  # that a cause needs: the kept table of bench_naming_quadruped; else the usual
SLOW = {"aibo": ("diagnose",)}  # half an hour and more of a robot: not asked unless named
NOMINAL, BTR = "nominal", "btr"
PEER = "mujoco.sysid"
ITERATIONS = 30  # of mujoco.sysid
TRIALS = 190  # of btr, as in the paper
ORACLES = 5  # searches in the robot's own simulator: all shares are of its speed, so it must hang on none
LOGS = tuple(name for name, kind in METHODS.items() if not kind.tries)  # methods that take one
WHEELED = ("diffdrive",)


def asked(session: dynreg.Session, secret: Secret, held: str, method: str, threads: int) -> dict:
    """What a method of `calibrate` answers about a registered recording."""
    told = {"plan": plan(Path(session.registry.path), secret.robot)} if method == "staged" else {}
    if secret.robot in BUDGET and "budget" in METHODS[method].reads:
        told["budget"] = BUDGET[secret.robot]
    found = session.calibrate(secret.name, method=method, hold_out=held, threads=threads, seed=1, **told)
    return {
        "error": found.test_error,
        "nominal": found.nominal_test_error,
        "rollouts": found.cost.rollouts,
        "core seconds": found.cost.core_seconds,
        "causes": found.causes,
        "ended": found.ended,
        "made": found.simulator,
    }


def diagnosed(session: dynreg.Session, secret: Secret, cut: Data, held: str, threads: int) -> dict:
    """A diagnosis that names one cause at most, without robots of its own for the threshold."""
    began = time.process_time()
    found = session.diagnose(
        secret.name, hold_out=held, threshold_runs=0, max_causes=1, threads=threads, seed=1
    )
    passed = [c.key for c in found.causes if c.evidence_nats >= NATS.get(secret.robot, USUAL)]
    made = found.extended_simulator if passed else found.calibrated_simulator
    return {
        **judged(cut, SimConfig.from_dict(session.registry.simulator(made)), threads),
        "rollouts": found.cost.rollouts,
        "core seconds": time.process_time() - began,
        "causes": passed,
        "ended": found.verdict,
        "made": made,
    }


def by_scores(session: dynreg.Session, cut: Data, hidden: Hidden, threads: int) -> dict:
    """Back to Reality on the robot, which has not read the log."""
    began, rules = time.process_time(), scaled(SCALE)
    door = Walks(cut.robot, hidden, threads).real
    found = session.calibrate(
        cut.robot, method=BTR, robot_door=door, rules=rules, threads=threads, seed=1, trials=TRIALS
    )
    return {
        **judged(cut, SimConfig.from_dict(session.registry.simulator(found.simulator)), threads),
        "rollouts": found.cost.rollouts,
        "core seconds": time.process_time() - began,
        "ended": found.ended,
        "trials": found.cost.trials,
        "real seconds": found.cost.trial_seconds,
        "real falls": found.cost.falls,
        "made": found.simulator,
    }


def judged(cut: Data, made: SimConfig, threads: int) -> dict[str, float]:
    """{"error", "nominal"} of a simulator on what was held out."""
    both = [SimConfig.of(cut.robot, cut.start), made]
    nominal, error = replay_errors(cut, both, threads)[:, 1].tolist()
    return {"error": error, "nominal": nominal}


def itself(cut: Data, hidden: Hidden) -> SimConfig:
    """The simulator with the true parameters; without a cause that the library's effects do not state alike."""
    stated = Terms(hidden.terms, tuple(v[None] for v in hidden.values))
    known = all(np.isfinite(v).all() for v in hidden.values)
    return SimConfig.of(cut.robot, hidden.parameters, effects_of(stated) if known and hidden.terms else {})


def identified(cut: Data, threads: int) -> dict | None:
    """mujoco.sysid with all parameters free, from where the log begins; None where its packages are missing."""
    from mujoco import sysid

    if not hasattr(sysid, "ParameterDict"):
        return None
    logging.getLogger("absl").setLevel(logging.ERROR)
    began, ran = time.process_time(), 0
    space, start = cut.robot.space, cut.start
    free = np.flatnonzero(np.isnan(cut.known))
    replayer = Replayer(cut.robot, cut.windows, threads)
    parameters = sysid.ParameterDict()
    for p, value in zip((space.parameters[i] for i in free), start[free], strict=True):
        parameters.add(sysid.Parameter(p.name, value, p.low, p.high))

    def values(x: np.ndarray) -> np.ndarray:
        out = np.tile(start, (x.shape[1], 1))
        out[:, free] = x.T
        return out

    def residual(x: np.ndarray, _: object) -> tuple:
        nonlocal ran
        columns = np.asarray(x).reshape(len(free), -1)
        ran += columns.shape[1]
        left = np.nan_to_num(replayer.residuals(values(columns), cut.parts.chosen))
        left = left.reshape(columns.shape[1], -1).T
        return [left if np.ndim(x) == 2 else left[:, 0]], None, None

    reach = np.array([space.parameters[i].high - space.parameters[i].low for i in free])
    with contextlib.redirect_stdout(io.StringIO()):  # its optimiser tells every iteration
        fitted, _ = sysid.optimize(
            parameters, residual, optimizer="mujoco", verbose=False, x_scale=reach, max_iters=ITERATIONS
        )
    found = values(fitted.as_vector()[:, None])[0]
    spent, made = time.process_time() - began, SimConfig.of(cut.robot, found)
    told = {"rollouts": ran, "core seconds": spent, "ended": "converged"}
    return {**judged(cut, made, threads), **told}


def named(robot: Robot, hidden: Hidden, causes: list[str] | None) -> str | None:
    """Whether the first of the named causes is the hidden one; None of a method that names none."""
    if causes is None:
        return None
    if not causes:
        return "none"
    return "right" if any(causes[0] in names for names in right_names(robot, hidden)) else "wrong"


def answers(session: dynreg.Session, secret: Secret, given: argparse.Namespace, done: set) -> Iterator[dict]:
    """A line for each method that was not asked about this robot before."""
    walking = secret.robot == "quadruped" and secret.number < given.walks
    asked_of = [m for m in given.methods or usual(secret.robot) if walking or m != BTR]
    methods = [m for m in asked_of if able(m, secret.robot)]
    left = [m for m in methods if key_of(secret.key | {"method": m}) not in done]
    if not left:
        return
    robot = described(secret.robot)
    hidden, log = secret.log()
    held = ",".join(e.name for e in log.episodes if e.name.startswith("test"))
    session.ingest(log, robot, name=secret.name)
    cut, walks = data(robot, log, held), Walks(robot, hidden, given.threads)
    for method in left:
        try:
            found, made = answer(session, secret, cut, hidden, held, method, given)
        except DynregError as problem:
            found, made = {"problem": str(problem)}, None
        if found is None:
            continue
        line = {**secret.key, "method": method, "cause": secret.cause}
        if "error" in found:
            line["share"] = found["error"] / found["nominal"]
        if walking and made is not None:
            line["walk"] = walks.figures(made, ORACLES if method == TRUE else SEARCHES)
        yield line | {"told": named(robot, hidden, found.get("causes")), **found}


def usual(robot: str) -> list[str]:
    """The methods that are asked about a robot where none is named."""
    feet = [NOMINAL, BTR] if robot in FEET else []
    return [m for m in (TRUE, *feet, *LOGS, PEER) if m not in SLOW.get(robot, ())]


def able(method: str, robot: str) -> bool:
    """Whether a method applies to a robot, and there is what it needs."""
    if method == BTR:
        return robot == "quadruped"
    needs = METHODS[method].needs if method in METHODS else ()
    if "population" in needs:
        return bool(ENTRIES[robot])
    return "wheels" not in needs or robot in WHEELED


def answer(
    session: dynreg.Session,
    secret: Secret,
    cut: Data,
    hidden: Hidden,
    held: str,
    method: str,
    given: argparse.Namespace,
) -> tuple[dict | None, SimConfig | None]:
    """What a method answers, None where its packages are missing; and the simulator where one is registered."""
    threads, free = given.threads, {"rollouts": 0, "core seconds": 0.0, "ended": ""}
    if method in (TRUE, NOMINAL):
        made = itself(cut, hidden) if method == TRUE else SimConfig.of(cut.robot, cut.start)
        found = judged(cut, made, threads)
        if method == TRUE and secret.robot in FEET:
            found["error"] = judged(replace(cut, robot=finer(cut.robot)), made, threads)["error"]
        return {**found, **free}, made
    if method == PEER:
        return identified(cut, threads), None
    if method == BTR:
        found = by_scores(session, cut, hidden, threads)
    elif method == "diagnose" and (given.quick or secret.robot in FEET):
        found = diagnosed(session, secret, cut, held, threads)
    else:
        found = asked(session, secret, held, method, threads)
    identity = found.pop("made", None)
    return found, identity and SimConfig.from_dict(session.registry.simulator(identity))


def key_of(line: dict) -> tuple:
    """What tells a line from others."""
    return tuple(line.get(k) for k in ("robot", "hidden", "number", "seconds", "episodes", "method"))


def main() -> None:
    """Print the table; that of the reporting robots is kept."""
    every = [TRUE, NOMINAL, BTR, *LOGS, PEER]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=["servo_pendulum", "diffdrive"], choices=list(PLANS))
    parser.add_argument("--methods", nargs="*", choices=every, help="by default all that apply")
    parser.add_argument("--robots", type=int, default=12, help="of each kind, in the family and outside")
    parser.add_argument("--hidden", nargs="*", default=HIDDEN, choices=HIDDEN, help="kinds of them")
    parser.add_argument(
        "--walks", type=int, default=3, help="quadrupeds of each kind that btr and gaits are tried on"
    )
    parser.add_argument("--seconds", type=float, nargs="*", default=[50.0], help="of a robot's log")
    parser.add_argument(
        "--episodes", type=int, nargs="*", default=[], help="of it that may shape an answer; else all"
    )
    parser.add_argument("--quick", action="store_true", help="diagnose by the usual threshold, for one cause")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--journal", type=Path, default=RESULTS / "methods.jsonl")
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no table")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    head = {"seed": seed, "entries": ENTRIES, "plans": PLANS, "size": SIZE, "quick": given.quick}
    journal = Journal(given.journal, head)
    journal.begin()
    for robot in given.only:
        done = {key_of(x) for x in journal.lines()}
        with tempfile.TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:
            if {"nearest", "synthesis"} & {*(given.methods or LOGS)} and ENTRIES[robot]:
                session.populate(described(robot), ENTRIES[robot], seed=seed, threads=given.threads)
            for secret in (one for one in secrets(robot, given, seed) if one.hidden in given.hidden):
                for line in answers(session, secret, given, done):
                    journal.add(line)
                    print(json.dumps(line), flush=True)
    show(journal.lines())
    keep(RESULTS / "methods.json", head | {"cells": journal.lines()}, parser, given)


if __name__ == "__main__":
    main()
