"""Hidden effects on the servo bench: how often a diagnosis names them, and how often it cries wolf.

Every robot is fresh: its seed was never used in development (`REPORT`). The truth runs on another engine than the
diagnosis, with a finer time step, nameplate errors, a torque disturbance, sensor noise and quantisation. The
threshold comes from robots without an effect of other seeds. 50 s a log: 20 to fit, 20 to select, 10 to test.
With `--truth independent` other code than the library's simulates the robots; they hide one cause each.
"""

import time
from dataclasses import replace

from naming import (
    TUNE,
    Job,
    arguments,
    group,
    journal_of,
    report,
    report_absent,
    report_pairs,
    run_all,
    seeds,
    threshold,
    titled,
    write,
)

from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.truth import protocol
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import load_robot
from dynreg.truths.table import causes_of

REPORT = 20261208


def pairs(keys: list[str], count: int, seed: int) -> list[tuple[tuple[str, str], str, int]]:
    """Pairs of effects of different groups, medium or strong, with seeds of their robots."""
    rng, out = stream(seed, "pairs"), []
    while len(out) < count:
        one, other = rng.choice(len(keys), 2, replace=False)
        first, second = term(keys[one]).effect, term(keys[other]).effect
        if first.group and first.group == second.group:
            continue
        size = SIZES[1 + int(rng.integers(2))]
        out.append(((keys[one], keys[other]), size, stream_seed(seed, "pair", len(out)) % 2**31))
    return out


def main() -> None:
    """Print the tables and write benchmarks/results/naming.json."""
    parser = arguments(__doc__, none=150, threshold_runs=100, processes=2, interval=True)
    parser.add_argument("--robot", default="servo_pendulum")
    parser.add_argument("--robots", type=int, default=8, help="fresh robots for each effect and size")
    parser.add_argument("--sizes", nargs="*", default=list(SIZES), choices=SIZES)
    parser.add_argument("--only", nargs="*", help="effects; all by default")
    parser.add_argument("--pairs", type=int, default=60, help="robots with two causes at once")
    parser.add_argument("--absent", type=int, default=2, help="robots for each effect whose cause is removed")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robot = load_robot(given.robot)
    plan = protocol(robot, seed=TUNE)
    journal = journal_of(given, robot, seed)
    needed = threshold(given.robot, robot, plan, given, journal)
    keys = [t.key for t in single_terms(robot) if not t.joints]
    chosen = keys if given.only is None else [term(k).key for k in given.only]
    if given.truth == "independent":
        chosen = list(given.only or causes_of(given.robot, "same"))
    one = Job(robot, plan, (), None, 0, needed, share=True, interval=given.interval, truth=given.truth)
    hidden = [
        replace(one, keys=(k,), size=s, seed=n)
        for k in chosen
        for s in given.sizes
        for n in seeds(seed, k, s, n=given.robots)
    ]
    none = [replace(one, seed=n) for n in seeds(seed, "none", n=given.none)]
    plain = replace(one, share=False, interval=False)
    absent = [
        replace(plain, keys=(k,), size="medium", seed=n, without=group(robot, k))
        for k in chosen
        for n in seeds(seed, k, "absent", n=given.absent)
    ]
    two = [
        replace(plain, keys=both, size=s, seed=n, max_causes=3)
        for both, s, n in pairs(keys, given.pairs if given.truth == "own" else 0, seed)
    ]
    began = time.perf_counter()
    done = run_all(hidden + none + absent + two, given.processes, journal)
    seconds = time.perf_counter() - began
    alone, rest = done[: len(hidden + none)], done[len(hidden + none) :]
    out = report(titled(given.robot, given.truth), alone, needed)
    out |= {"absent": report_absent(rest[: len(absent)]), "pairs": report_pairs(rest[len(absent) :])}
    out["seconds"]["all"] = seconds
    print(f"{len(done)} diagnoses in {seconds:.0f} s")
    write("naming.json" if given.truth == "own" else "naming_servo_independent.json", out, given)


if __name__ == "__main__":
    main()
