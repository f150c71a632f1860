"""Hidden robots by code that shares nothing with the library: a servo, an arm of two joints, wheels.

Of each robot: causes of the library, medium and strong, half of them with the library's physics and half with other
physics that has a name in it; robots without a cause; and causes that lie outside the library. Every robot is fresh:
its seed was never used in development (`REPORT`); thresholds come from the library's own simulated robots without an
effect. The diagnosis knows none of this. 50 s a log: 20 to fit, 20 to select, 10 to test; wheels 25 s.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace

from independent_rows import rows_of
from naming import TUNE, Job, arguments, journal_of, report, run_all, seeds, threshold, titled, write

from dynreg.diagnose.threshold import Threshold
from dynreg.evidence.truth import protocol
from dynreg.results.trials import TrialResult
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot

# first seeds of the report, of each kind, which nothing was chosen by
REPORT = {
    "servo_pendulum": 20261223,
    "two_joint_arm": 20261223,
    "diffdrive": 20261221,
    "six_joint_arm": 20261223,
}
SIZES = ("medium", "strong")
SECONDS = {"servo_pendulum": 50.0, "two_joint_arm": 50.0, "diffdrive": 25.0, "six_joint_arm": 50.0}


def hidden(one: Job, kind: str, causes: Sequence[str], count: int, seed: int) -> list[Job]:
    """`count` robots of a kind of row; every cause has its turn before one has a second, in an order that is drawn."""
    name = one.robot.name
    rng = stream(seed, "causes", name, kind)
    turns = [c for _ in range(-(-count // max(len(causes), 1))) for c in rng.permutation(causes)][:count]
    drawn = zip(turns, seeds(seed, name, kind, n=count), strict=False)
    return [
        replace(one, keys=(str(c),), size=SIZES[i % len(SIZES)], seed=n) for i, (c, n) in enumerate(drawn)
    ]


def jobs(one: Job, given: argparse.Namespace, seed: int) -> list[Job]:
    """The robots of one kind."""
    rows = rows_of(one.robot)
    half = given.robots // 2
    return [
        *hidden(one, "same", rows.same, given.robots - half, seed),
        *hidden(one, "other", rows.other, half, seed),
        *(replace(one, seed=n) for n in seeds(seed, one.robot.name, "none", n=given.none)),
        *hidden(one, "outside", rows.outside, given.outside, seed),
    ]


def tables(robot: Robot, done: Sequence[TrialResult], needed: Threshold) -> dict:
    """The tables of one robot, the causes of the library's physics and of other physics beside each other, too."""
    out = report(titled(robot.name, "independent"), done, needed)
    rows = rows_of(robot)
    for kind, causes in (("same", rows.same), ("other", rows.other)):
        mine = [r for r in done if r.hidden in causes]
        if mine:
            out[kind] = report(f"{titled(robot.name, 'independent')}, {kind} physics", mine, needed)
    return out


def main() -> None:
    """Print the tables and write benchmarks/results/naming_independent.json."""
    parser = arguments(__doc__, none=50, threshold_runs=100, processes=1, interval=True)
    parser.set_defaults(truth="independent")
    parser.add_argument("--kinds", nargs="*", default=["servo_pendulum", "two_joint_arm", "diffdrive"])
    parser.add_argument("--robots", type=int, default=50, help="robots of each kind that hide a named cause")
    parser.add_argument("--outside", type=int, default=20, help="robots of each kind that hide another one")
    given = parser.parse_args()
    out, every, began = {}, [], time.perf_counter()
    for name in given.kinds:
        robot, seed = load_robot(name), TUNE if given.tune else REPORT[name]
        plan = protocol(robot, seed=TUNE, seconds=SECONDS[name])
        own = given.journal and given.journal.with_stem(f"{given.journal.stem}_{name}")
        journal = journal_of(argparse.Namespace(journal=own), robot, seed)
        needed = threshold(name, robot, plan, given, journal)
        one = Job(robot, plan, (), None, 0, needed, interval=given.interval, truth=given.truth)
        done = run_all(jobs(one, given, seed), given.processes, journal)
        every += done
        out[name] = tables(robot, done, needed)
    if len(given.kinds) > 1:
        out["all"] = report("all kinds, independent truth", every, Threshold(0.0, ()))
    seconds = time.perf_counter() - began
    print(f"{len(every)} diagnoses in {seconds:.0f} s")
    write("naming_independent.json", out, given)


if __name__ == "__main__":
    main()
