"""Hidden effects on the servo bench: how often a diagnosis names them, and how often it cries wolf.

Every robot is fresh: its seed was never used in development (`REPORT`). The truth runs on another engine than the
diagnosis, with a finer time step, nameplate errors, a torque disturbance, sensor noise and quantisation. The
threshold comes from robots without an effect of other seeds. 50 s a log: 20 to fit, 20 to select, 10 to test.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from dynreg.diagnose.hypothesis import single_terms
from dynreg.diagnose.settings import TrialSettings
from dynreg.diagnose.trial import one_trial, trial_threshold
from dynreg.diagnose.truth import protocol
from dynreg.results.trials import TrialTable
from dynreg.rng import stream_seed
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import load_robot

TUNE, REPORT = 3, 20261125
RESULTS = Path(__file__).parent / "results"


def job(given: tuple[str, str | None, str | None, int, float, bool]):
    """One trial: (robot, effect or None, size, seed, threshold, whether the effect's group is removed)."""
    name, key, size, seed, needed, absent = given
    robot = load_robot(name)
    terms = () if key is None else (term(key),)
    without = ()
    if absent:
        group = terms[0].effect.group
        without = tuple(
            t.effect.id
            for t in single_terms(robot)
            if t.effect.id == key or (group and t.effect.group == group)
        )
    plan = protocol(robot, seed=TUNE)
    return one_trial(robot, plan, terms, size, seed, needed, TrialSettings(threads=1), without=without)


def main() -> None:
    """Print the tables and write benchmarks/results/naming.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--robot", default="servo_pendulum")
    parser.add_argument("--robots", type=int, default=8, help="fresh robots for each effect and size")
    parser.add_argument("--none", type=int, default=150, help="robots without an effect")
    parser.add_argument("--sizes", nargs="*", default=list(SIZES))
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
        (given.robot, k, s, seed, needed, False)
        for k in keys
        for s in given.sizes
        for seed in seeds(k, s, n=given.robots)
    ]
    none = [(given.robot, None, None, seed, needed, False) for seed in seeds("none", n=given.none)]
    absent = [
        (given.robot, k, "medium", seed, needed, True)
        for k in keys
        for seed in seeds(k, "absent", n=given.absent)
    ]
    began = time.perf_counter()
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(job, hidden + none + absent))
    seconds = time.perf_counter() - began
    many = len(hidden) + len(none)
    table = TrialTable.of(given.robot, found[:many], [f"threshold {needed:.3g} nats"])
    print(table)
    for size, rate in table.by_size.items():
        print(f"right, {size}: {rate.value:.3f} [{rate.low:.3f}, {rate.high:.3f}] of {rate.of}")
    for name in ("wrong", "false_alarm", "in_set"):
        rate = getattr(table, name)
        if rate is not None:
            print(f"{name}: {rate.value:.3f} [{rate.low:.3f}, {rate.high:.3f}] of {rate.of}")
    print(
        f"sets: median {table.set_median}, 95 % {table.set_p95}; share of the attainable gain, median "
        f"{table.gain_share_median}; error of the size, median {table.parameter_error_median}"
    )
    for c in table.confusions:
        print(f"  {c.hidden} -> {c.named}: {c.count}")
    confident = [r for r in found[many:] if r.verdict in ("named", "ambiguous")]
    if absent:
        print(f"cause absent: confident wrong names {len(confident)} of {len(absent)}")
        for r in confident:
            print(f"  {r.hidden} -> {r.named}")
    print(f"{len(found)} diagnoses in {seconds:.0f} s; median {table.seconds_median:.1f} s each")
    RESULTS.mkdir(exist_ok=True)
    out = table.to_dict() | {"absent": {"wrong": len(confident), "of": len(absent)}, "threshold": needed}
    (RESULTS / "naming.json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
