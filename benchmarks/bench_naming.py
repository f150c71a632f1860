"""Hidden effects on the servo bench: how often a diagnosis names them, and how often it cries wolf.

Every robot is fresh: its seed was never used in development (`REPORT`). The truth runs on another engine than the
diagnosis, with a finer time step, nameplate errors, a torque disturbance, sensor noise and quantisation. The
threshold comes from robots without an effect of other seeds. 50 s a log: 20 to fit, 20 to select, 10 to test.
"""

import argparse
import json
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from dynreg.diagnose.hypothesis import single_terms
from dynreg.diagnose.settings import TrialSettings
from dynreg.diagnose.trial import one_trial, trial_threshold
from dynreg.diagnose.truth import protocol
from dynreg.results.trials import Rate, TrialTable, rate
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import load_robot

TUNE, REPORT = 3, 20261125
RESULTS = Path(__file__).parent / "results"


def job(given: tuple[str, tuple[str, ...], str | None, int, float, bool, int]):
    """One trial: (robot, effects, size, seed, threshold, whether the effects' groups are removed, causes at most)."""
    name, keys, size, seed, needed, absent, causes = given
    robot = load_robot(name)
    terms = tuple(term(key) for key in keys)
    groups = {t.effect.group for t in terms if t.effect.group}
    without = tuple(
        t.effect.id for t in single_terms(robot) if t.effect.id in keys or t.effect.group in groups
    )
    plan = protocol(robot, seed=TUNE)
    settings = TrialSettings(threads=1)
    return one_trial(
        robot, plan, terms, size, seed, needed, settings, without=without if absent else (), max_causes=causes
    )


def pairs(keys: list[str], count: int) -> list[tuple[tuple[str, str], str, int]]:
    """Pairs of effects of different groups, medium or strong, with seeds of their robots."""
    rng, out = stream(REPORT, "pairs"), []
    while len(out) < count:
        one, other = rng.choice(len(keys), 2, replace=False)
        first, second = term(keys[one]).effect, term(keys[other]).effect
        if first.group and first.group == second.group:
            continue
        size = SIZES[1 + int(rng.integers(2))]
        out.append(((keys[one], keys[other]), size, stream_seed(REPORT, "pair", len(out)) % 2**31))
    return out


def interval(share: Rate) -> str:
    """A rate with its 90 % interval."""
    return f"{share.value:.3f} [{share.low:.3f}, {share.high:.3f}] of {share.of}"


def report_effects(table: TrialTable) -> None:
    """Of each effect how often it was named at each size, and the median error of its size where it was."""
    print(f"{'right of robots':24s} " + " ".join(f"{s:>8s}" for s in SIZES) + "   error of the size")
    for key in dict.fromkeys(t.hidden for t in table.trials if t.hidden):
        mine = [t for t in table.trials if t.hidden == key]
        cells = []
        for size in SIZES:
            sized = [t for t in mine if t.size == size]
            cells.append(f"{sum(t.right for t in sized)}/{len(sized)}")
        errors = [t.parameter_error for t in mine if t.right and t.parameter_error is not None]
        median = f"{statistics.median(errors):.3f}" if errors else "-"
        print(f"{key:24s} " + " ".join(f"{c:>8s}" for c in cells) + f"   {median}")


def main() -> None:
    """Print the tables and write benchmarks/results/naming.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--robot", default="servo_pendulum")
    parser.add_argument("--robots", type=int, default=8, help="fresh robots for each effect and size")
    parser.add_argument("--none", type=int, default=150, help="robots without an effect")
    parser.add_argument("--sizes", nargs="*", default=list(SIZES))
    parser.add_argument("--pairs", type=int, default=60, help="robots with two causes at once")
    parser.add_argument("--absent", type=int, default=2, help="robots for each effect whose cause is removed")
    parser.add_argument("--threshold-runs", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    robot = load_robot(given.robot)
    began = time.perf_counter()
    settings = TrialSettings(threshold_runs=given.threshold_runs, seed=TUNE, threads=0)
    needed = trial_threshold(None, robot, protocol(robot, seed=TUNE), settings)
    print(
        f"threshold {needed:.1f} nats from {given.threshold_runs} robots, {time.perf_counter() - began:.0f} s"
    )
    keys = [t.key for t in single_terms(robot) if not t.joints]

    def seeds(*names: object, n: int) -> list[int]:
        return [stream_seed(REPORT, *names, i) % 2**31 for i in range(n)]

    hidden = [
        (given.robot, (k,), s, seed, needed, False, 1)
        for k in keys
        for s in given.sizes
        for seed in seeds(k, s, n=given.robots)
    ]
    none = [(given.robot, (), None, seed, needed, False, 1) for seed in seeds("none", n=given.none)]
    absent = [
        (given.robot, (k,), "medium", seed, needed, True, 1)
        for k in keys
        for seed in seeds(k, "absent", n=given.absent)
    ]
    two = [(given.robot, both, s, seed, needed, False, 3) for both, s, seed in pairs(keys, given.pairs)]
    began = time.perf_counter()
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        found = []
        for result in pool.map(job, hidden + none + absent + two):
            found.append(result)
            if len(found) % 50 == 0:  # a run that is stopped still says how far it came, and how well
                told = [r for r in found if r.hidden]
                print(
                    f"{len(found)} done: right {sum(r.right for r in told)} of {len(told)}, "
                    f"wrong {sum(r.wrong for r in told)}",
                    flush=True,
                )
    seconds = time.perf_counter() - began
    many = len(hidden) + len(none)
    table = TrialTable.of(given.robot, found[:many], [f"threshold {needed:.3g} nats"])
    print(table)
    report_effects(table)
    for size, found_of in table.by_size.items():
        print(f"right, {size}: {interval(found_of)}")
    for name in ("wrong", "false_alarm", "in_set"):
        share = getattr(table, name)
        if share is not None:
            print(f"{name}: {interval(share)}")
    print(
        f"sets: median {table.set_median}, 95 % {table.set_p95}; share of the attainable gain, median "
        f"{table.gain_share_median}; error of the size, median {table.parameter_error_median}"
    )
    for c in table.confusions:
        print(f"  {c.hidden} -> {c.named}: {c.count}")
    confident = [r for r in found[many : many + len(absent)] if r.verdict in ("named", "ambiguous")]
    if absent:
        print(f"cause absent: confident wrong names {len(confident)} of {len(absent)}")
        for r in confident:
            print(f"  {r.hidden} -> {r.named}")
    double = found[many + len(absent) :]
    both = rate(r.right for r in double)
    if both is not None:
        print(f"two causes at once, both named: {interval(both)}")
        for r in double:
            if not r.right:
                print(f"  {r.hidden} ({r.size}): {r.verdict}, {', '.join(r.causes) or 'no cause'}")
    print(f"{len(found)} diagnoses in {seconds:.0f} s; median {table.seconds_median:.1f} s each")
    RESULTS.mkdir(exist_ok=True)
    out = table.to_dict() | {
        "absent": {"wrong": len(confident), "of": len(absent)},
        "pairs": None if both is None else both.to_dict(),
        "threshold": needed,
        "seconds": seconds,
    }
    (RESULTS / "naming.json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
