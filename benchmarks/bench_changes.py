"""How often `dynreg drift` errs on robots without wheels: changes that it names where none was, and those it finds.

Hidden robots are drawn from the nameplate of packaged ones; every other has an effect that the plain model lacks, the
same in both recordings. The truth runs with a finer time step and another integrator, is disturbed, and is read by
noisy, quantised sensors. The two recordings have commands of their own: other levels and chirps, and in the later one
four fifths of the reach and longer episodes. In between nothing changes, or one parameter does: by a factor whose size
is drawn (15 to 40 %, uniform in its logarithm, up or down), or a zero by 0.01 to 0.04 rad.

A false alarm is a verdict `changed` where nothing did. A change is found where the verdict is `changed`; it is rightly
named where the first change is that parameter, or what no log tells from it; wrongly where another parameter comes
first. Every drift is asked with its usual settings, but for the threshold: it is the usual one of 20 nats, which takes
no simulations. Thresholds that a servo's own simulations set are near 8 nats: what would pass these is told as well.
"""

import argparse
import json
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from journal import Journal
from kept import RESULTS
from scipy.stats import binomtest

import dynreg
from dynreg.data.recording import Recording
from dynreg.evidence.truth import Hidden, hide, log_of, protocol
from dynreg.results import Changes
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

FILE = RESULTS / "changes.json"
TUNE, REPORT = 67, 20261215
SECONDS = 12.5
SMALLER, LONGER = 0.8, 1.25  # of the later recording: reach, and seconds of an episode
EPISODE = 2.5  # s
LOWER = 8.0  # nats, of a servo's own threshold
SIZES = (0.15, 0.4)  # of a change, as a share of the value
ZEROS = (0.01, 0.04)  # rad
NOTHING = "nothing"


@dataclass(frozen=True)
class Bench:
    """A packaged robot: parameters that may change, with what no log tells from them, and effects that it may have."""

    robot: str
    changing: dict[str, tuple[str, ...]]
    hides: tuple[str, ...]


BENCHES = {
    "servo_pendulum": Bench(
        "servo_pendulum",
        {
            "tip_mass": ("payload (mass)",),
            "viscous_friction": ("viscous_friction (torque)",),
            "coulomb_friction": ("coulomb_friction (torque)",),
            "zero_offset": (
                "encoder_offset (angle)",
                "gravity_tilt (angle)",
                "com_offset (shift)",
            ),
        },
        ("load_friction", "backlash", "cogging", "command_lag"),
    ),
}


@dataclass(frozen=True)
class Case:
    """A hidden robot: what changes ("nothing" or a parameter), its own effect ("" for none), and the seed of all."""

    change: str
    hidden: str
    seed: int


def cases(bench: Bench, seed: int, changed: bool, many: int) -> list[Case]:
    """Hidden robots, each other one with an effect; changes in turn."""
    names, out = list(bench.changing), []
    for number in range(many):
        own = stream_seed(seed, bench.robot, str(changed), number) % 2**31
        effect = bench.hides[number // 2 % len(bench.hides)] if number % 2 else ""
        out.append(Case(names[number % len(names)] if changed else NOTHING, effect, own))
    return out


def both(robot: Robot, case: Case) -> tuple[Hidden, Hidden]:
    """The robot before and after."""
    terms = (term(case.hidden),) if case.hidden else ()
    before = hide(robot, terms, "medium" if terms else None, case.seed)
    if case.change == NOTHING:
        return before, before
    rng, names = stream(case.seed, "change"), list(robot.space.names)
    at, values, up = names.index(case.change), before.parameters.copy(), rng.choice([-1.0, 1.0])
    if robot.space.nominal[at] == 0.0:
        values[at] += up * rng.uniform(*ZEROS)
    else:
        values[at] *= 1.0 + up * np.exp(rng.uniform(*np.log(SIZES)))
    return before, replace(before, parameters=np.clip(values, *robot.space.bounds.T))


def recordings(robot: Robot, case: Case) -> tuple[Recording, Recording]:
    """What the loggers of both write."""
    plans = (
        protocol(robot, seed=stream_seed(case.seed, "first") % 2**31, seconds=SECONDS, episode=EPISODE),
        protocol(
            robot,
            seed=stream_seed(case.seed, "second") % 2**31,
            seconds=LONGER * SECONDS,
            episode=LONGER * EPISODE,
            reach=SMALLER,
        ),
    )
    engine = "mujoco" if "mujoco" in robot.engines else None
    truths = both(robot, case)
    seeded = (truths[0], replace(truths[1], seed=stream_seed(case.seed, "noise") % 2**31))
    return tuple(log_of(robot, one, plan, engine=engine) for one, plan in zip(seeded, plans, strict=True))


def asked(robot: Robot, case: Case, place: Path) -> Changes:
    """The drift between a case's recordings, in a registry of its own."""
    with dynreg.open(place / f"{case.seed}") as session:
        for name, one in zip(("before", "after"), recordings(robot, case), strict=True):
            session.ingest(one, robot, name=name)
        return session.drift("after", "before", threshold_runs=0, threads=1)


def row(bench: Bench, robot: Robot, case: Case, found: Changes, seconds: float) -> dict:
    """What was said of a case."""
    truths = both(robot, case)
    at = list(robot.space.names).index(case.change) if case.change != NOTHING else None
    true = None if at is None else float(truths[1].parameters[at] - truths[0].parameters[at])
    told = next((one for one in found.changed if one.name == case.change), None)
    return {
        "robot": bench.robot,
        "change": case.change,
        "hidden": case.hidden,
        "seed": case.seed,
        "verdict": found.verdict,
        "named": [one.name for one in found.changed],
        "most nats": max(one.nats for one in found.changes),
        "true": true,
        "difference": None
        if told is None
        else [told.difference.value, told.difference.low, told.difference.high],
        "left": {name: [one.residual, one.noise] for name, one in found.left.items()},
        "threshold": found.threshold_nats,
        "seconds": seconds,
    }


def rows(bench: Bench, some: list[Case], journal: Journal) -> list[dict]:
    """What `drift` says of hidden robots, those in the journal left as they are."""
    robot = load_robot(bench.robot)
    done = {one["seed"]: one for one in journal.lines()}
    out = [done[case.seed] for case in some if case.seed in done]
    with tempfile.TemporaryDirectory() as place:
        for case in (one for one in some if one.seed not in done):
            began = time.perf_counter()
            found = asked(robot, case, Path(place))
            out.append(journal.add(row(bench, robot, case, found, time.perf_counter() - began)))
            told = {
                k: out[-1][k]
                for k in ("change", "hidden", "verdict", "named", "true", "difference", "seconds")
            }
            print(json.dumps(told), flush=True)
    return out


def share(some: int, many: int) -> dict:
    """A share with its 95 % interval (Clopper-Pearson)."""
    low, high = binomtest(some, many).proportion_ci(0.95)
    return {"number": some, "of": many, "share": some / many, "low": float(low), "high": float(high)}


def _right(bench: Bench, row: dict) -> bool:
    """Whether the first change that was named is the true one, or what no log tells from it."""
    return row["named"][:1] in ([one] for one in (row["change"], *bench.changing[row["change"]]))


def summed(bench: Bench, still: list[dict], changed: list[dict]) -> dict:
    """Shares of false alarms, of found and of rightly named changes."""
    alarms = [r for r in still if r["verdict"] == "changed"]
    found = [r for r in changed if r["verdict"] == "changed"]
    told = [r for r in changed if r["difference"] is not None]
    out = {
        "false alarms": share(len(alarms), len(still)),
        f"false alarms at {LOWER:g} nats": share(sum(r["most nats"] >= LOWER for r in still), len(still)),
        "unexplained where nothing changed": share(
            sum(r["verdict"] == "unexplained" for r in still), len(still)
        ),
        "changes found": share(len(found), len(changed)),
        "changes rightly named": share(sum(_right(bench, r) for r in changed), len(changed)),
        "unexplained where something changed": share(
            sum(r["verdict"] == "unexplained" for r in changed), len(changed)
        ),
    }
    if told:
        holds = sum(r["difference"][1] <= r["true"] <= r["difference"][2] for r in told)
        out["90 % interval holds the difference"] = share(holds, len(told))
    for name, one in out.items():
        print(f"{name}: {one['number']} of {one['of']} ({100 * one['low']:.0f} to {100 * one['high']:.0f} %)")
    return out


def main() -> None:
    """Print the figures, and keep them in benchmarks/results/changes.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", nargs="+", default=["servo_pendulum"], choices=list(BENCHES))
    parser.add_argument(
        "--pairs", type=int, default=20, help="of a robot that stayed as it was, and as many changed"
    )
    parser.add_argument("--only", choices=("still", "changed"), help="fill the journal with these alone")
    parser.add_argument("--journal", type=Path, default=Path(tempfile.gettempdir()) / "bench_changes.jsonl")
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes nothing")
    given = parser.parse_args()
    seed, out = TUNE if given.tune else REPORT, {}
    journal = Journal(given.journal, {"seed": seed, "seconds": SECONDS})
    journal.begin()
    for name in given.robots:
        bench = BENCHES[name]
        parts = {
            kind: rows(bench, cases(bench, seed, kind == "changed", given.pairs), journal)
            for kind in ("still", "changed")
            if given.only in (None, kind)
        }
        if given.only is None:
            out[name] = {"figures": summed(bench, **parts), "pairs": parts["still"] + parts["changed"]}
    if out and not given.tune:
        FILE.write_text(json.dumps({"seed": seed, "robots": out}, indent=1) + "\n")


if __name__ == "__main__":
    main()
