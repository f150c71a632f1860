"""Every method on the same hidden robots: one question, one table.

Of each robot some are in the family (their parameters differ from the nameplate) and some are outside it (they hide a
cause besides, each another one). The servo and the wheels are simulated by code that shares nothing with the library;
the quadruped by the library's own. Each method gets the same log, of so many seconds of the robot, and its error is
the replay error on what was held out, as a share of the nominal simulator's. `the robot itself` has the true
parameters and, where the library has it, the true cause: what noise leaves. `mujoco.sysid` fits all parameters.

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
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_naming_independent import rows_of
from bootstrap import median_interval
from journal import Journal
from kept import keep
from naming import RESULTS, TUNE, seeds
from scipy.stats import wilcoxon

import dynreg
from dynreg.data.recording import Recording
from dynreg.diagnose.trial import Trial, Trials, hidden_log, right_names
from dynreg.evidence.truth import Hidden, protocol
from dynreg.methods.judged import replay_errors
from dynreg.methods.table import METHODS
from dynreg.replay.data import Data, data
from dynreg.replay.windows import Replayer
from dynreg.rng import stream
from dynreg.sim.config import SimConfig, effects_of
from dynreg.sim.effects import Terms, term
from dynreg.sim.robot import Robot, load_robot
from dynreg.timed.compare import holm
from dynreg.truths.table import KINDS

REPORT = 20261203
HIDDEN = ("in the family", "outside")
PLANS = {  # of `staged`: the drives first, then all
    "servo_pendulum": (("*_friction", "torque_constant", "resistance"), ("*",)),
    "quadruped": (("torque", "motor_speed"), ("*",)),
    "diffdrive": (("*",),),
}
ENTRIES = {"servo_pendulum": 300, "quadruped": 200, "diffdrive": 300}
WALKERS = ("load_friction", "payload", "command_lag", "torque_limit", "backlash", "ground_friction")
SIZE = "medium"
TRUE, PEER = "the robot itself", "mujoco.sysid"
ITERATIONS = 30  # of mujoco.sysid
SURE = 0.05


@dataclass(frozen=True)
class Secret:
    """A hidden robot: what of, which kind, its number in it, the seconds of its log, and what it hides."""

    robot: str
    hidden: str
    number: int
    seconds: float
    cause: str | None
    seed: int

    @property
    def key(self) -> dict:
        """What tells it from others."""
        return {"robot": self.robot, "hidden": self.hidden, "number": self.number, "seconds": self.seconds}

    def log(self) -> tuple[Hidden, Recording]:
        """What it hides, and what it wrote."""
        robot = load_robot(self.robot)
        plan = protocol(robot, seed=self.seed, seconds=self.seconds)
        if self.robot in KINDS:
            trial = Trial((), SIZE if self.cause else None, self.seed, cause=self.cause)
            return hidden_log(Trials(robot, plan, truth="independent"), trial)
        terms = () if self.cause is None else (term(self.cause),)
        return hidden_log(Trials(robot, plan), Trial(terms, SIZE if terms else None, self.seed))


def secrets(robot: str, given: argparse.Namespace, seed: int) -> Iterator[Secret]:
    """The robots of a table; every cause has its turn before one has a second, in an order that is drawn."""
    own = load_robot(robot)
    causes = (*rows_of(own).same, *rows_of(own).other) if robot in KINDS else WALKERS
    turns = stream(seed, "methods", robot, "causes").permutation(causes)
    for hidden in HIDDEN:
        for number, one in enumerate(seeds(seed, "methods", robot, hidden, n=given.robots)):
            cause = str(turns[number % len(turns)]) if hidden == "outside" else None
            for seconds in given.seconds:
                yield Secret(robot, hidden, number, seconds, cause, one)


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


def asked(session: dynreg.Session, name: str, secret: Secret, held: str, method: str, threads: int) -> dict:
    """What a method of `calibrate` answers about a registered recording."""
    told = {"plan": plan(Path(session.registry.path), secret.robot)} if method == "staged" else {}
    found = session.calibrate(name, method=method, hold_out=held, threads=threads, seed=1, **told)
    return {
        "error": found.test_error,
        "nominal": found.nominal_test_error,
        "rollouts": found.cost.rollouts,
        "core seconds": found.cost.core_seconds,
        "causes": found.causes,
        "ended": found.ended,
    }


def itself(cut: Data, hidden: Hidden, threads: int) -> dict:
    """The simulator with the true parameters; without a cause that the library's effects do not state alike."""
    stated = Terms(hidden.terms, tuple(v[None] for v in hidden.values))
    known = all(np.isfinite(v).all() for v in hidden.values)
    true = SimConfig.of(cut.robot, hidden.parameters, effects_of(stated) if known and hidden.terms else {})
    nominal, error = replay_errors(cut, [SimConfig.of(cut.robot, cut.start), true], threads)[:, 1].tolist()
    return {"error": error, "nominal": nominal, "rollouts": 0, "core seconds": 0.0, "ended": ""}


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
    spent = time.process_time() - began
    configs = [SimConfig.of(cut.robot, v) for v in (start, found)]
    nominal, error = replay_errors(cut, configs, threads)[:, 1].tolist()
    return {"error": error, "nominal": nominal, "rollouts": ran, "core seconds": spent, "ended": "converged"}


def named(robot: Robot, hidden: Hidden, causes: list[str] | None) -> str | None:
    """Whether the first of the named causes is the hidden one; None of a method that names none."""
    if causes is None:
        return None
    if not causes:
        return "none"
    return "right" if any(causes[0] in names for names in right_names(robot, hidden)) else "wrong"


def answers(session: dynreg.Session, secret: Secret, given: argparse.Namespace, done: set) -> Iterator[dict]:
    """A line for each method that was not asked about this robot before."""
    left = [m for m in given.methods if (*secret.key.values(), m) not in done]
    if not left:
        return
    robot = load_robot(secret.robot)
    hidden, log = secret.log()
    held = ",".join(e.name for e in log.episodes if e.name.startswith("test"))
    name = f"{secret.robot}_{secret.hidden}_{secret.number}_{secret.seconds:g}".replace(" ", "_")
    session.ingest(log, robot, name=name)
    cut = data(robot, log, held)
    for method in left:
        if method in METHODS and "wheels" in METHODS[method].needs and not robot.planar:
            continue
        if method == TRUE:
            found = itself(cut, hidden, given.threads)
        elif method == PEER:
            found = identified(cut, given.threads)
        else:
            found = asked(session, name, secret, held, method, given.threads)
        if found is not None:
            told = named(robot, hidden, found.get("causes"))
            share = found["error"] / found["nominal"]
            yield {
                **secret.key,
                "method": method,
                "cause": secret.cause,
                "share": share,
                "told": told,
                **found,
            }


def main() -> None:
    """Print the table; that of the reporting robots is kept."""
    usable = [name for name, kind in METHODS.items() if not kind.tries]
    every = [TRUE, *usable, PEER]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=["servo_pendulum", "diffdrive"], choices=list(PLANS))
    parser.add_argument("--methods", nargs="*", default=every, choices=every)
    parser.add_argument("--robots", type=int, default=12, help="of each kind, in the family and outside")
    parser.add_argument("--seconds", type=float, nargs="*", default=[50.0], help="of a robot's log")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--journal", type=Path, default=RESULTS / "methods.jsonl")
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no table")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    head = {"seed": seed, "entries": ENTRIES, "plans": PLANS, "size": SIZE}
    journal = Journal(given.journal, head)
    journal.begin()
    for robot in given.only:
        done = {
            (*(x[k] for k in ("robot", "hidden", "number", "seconds", "method")),) for x in journal.lines()
        }
        with tempfile.TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:
            if {"nearest", "synthesis"} & {*given.methods}:
                session.populate(load_robot(robot), ENTRIES[robot], seed=seed, threads=given.threads)
            for secret in secrets(robot, given, seed):
                for line in answers(session, secret, given, done):
                    journal.add(line)
                    print(json.dumps(line), flush=True)
    show(journal.lines())
    keep(RESULTS / "methods.json", head | {"cells": journal.lines()}, parser, given)


def show(lines: list[dict]) -> None:
    """Print the tables."""
    for key in dict.fromkeys((x["robot"], x["hidden"], x["seconds"]) for x in lines):
        own = [x for x in lines if (x["robot"], x["hidden"], x["seconds"]) == key]
        methods = list(dict.fromkeys(x["method"] for x in own))
        shares = {m: {x["number"]: x["share"] for x in own if x["method"] == m} for m in methods}
        rivals = {m: float(np.median([*s.values()])) for m, s in shares.items() if m != TRUE}
        best = min(rivals, key=rivals.__getitem__)
        p = {}
        for m in rivals:
            both = sorted(shares[m].keys() & shares[best].keys())
            apart = np.log([shares[m][n] / shares[best][n] for n in both])
            if m != best:
                p[m] = float(wilcoxon(apart).pvalue) if apart.any() else 1.0
        corrected = dict(zip(p, holm([*p.values()]), strict=True))
        print(f"{key[0]}, {key[1]}, {key[2]:g} s: {len(shares[best])} robots; best is {best}")
        for m in sorted(methods, key=lambda m: rivals.get(m, -1.0)):
            mine = [x for x in own if x["method"] == m]
            low, high = median_interval(np.array([*shares[m].values()]))
            runs, spent = (float(np.median([x[k] for x in mine])) for k in ("rollouts", "core seconds"))
            told = {t: sum(x["told"] == t for x in mine) for t in ("right", "wrong", "none")}
            words = ", ".join(f"{n} {t}" for t, n in told.items() if n)
            behind = (
                ""
                if m not in corrected
                else f"p {corrected[m]:.3f}{'' if corrected[m] < SURE else ' (not sure)'}"
            )
            middle = np.median([*shares[m].values()])
            print(
                f"  {m:16} {middle:6.3f} [{low:.3f}, {high:.3f}] {runs:8.0f} simulators {spent:7.1f} core s  "
                f"{behind}  {words}"
            )


if __name__ == "__main__":
    main()
