"""Hidden effects on a robot with two driven wheels: how often a diagnosis names them, and how often it cries wolf.

Every robot is fresh: its seed was never used in development (`REPORT`). The truth runs on the unicycle engine, the
diagnosis on the kinematic one, with a finer time step, nameplate errors, a disturbance, sensor noise and quantisation.
The threshold comes from robots without an effect of other seeds. 25 s a log: 10 to fit, 10 to select, 5 to test.

An encoder's scale is, to such a log, the wheels' size and the drags at once: how far it is named is what their stated
tolerances leave open. It is a row of its own.
"""

import time
from dataclasses import replace

from naming import TUNE, Job, arguments, journal_of, report, run_all, seeds, threshold, titled, write

from dynreg.evidence.truth import protocol
from dynreg.sim.effects import SIZES, term
from dynreg.sim.robot import load_robot

REPORT = 20261212
EFFECTS = (
    "wheel_gain",
    "wheel_slip",
    "drive_inertia",
    "turn_slowdown",
    "command_delay",
    "command_deadband",
    "rate_limit",
)
SCALE = ("encoder_scale",)


def main() -> None:
    """Print the tables and write benchmarks/results/naming_wheels.json."""
    parser = arguments(__doc__, none=60, threshold_runs=100, processes=2, interval=True)
    parser.add_argument("--robots", type=int, default=8, help="fresh robots for each effect and size")
    parser.add_argument("--seconds", type=float, default=25.0, help="of a log")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robot = load_robot("diffdrive")
    plan = protocol(robot, seed=TUNE, seconds=given.seconds)
    journal = journal_of(given, robot, seed)
    needed = threshold("diffdrive", robot, plan, given, journal)
    one = Job(robot, plan, (), None, 0, needed, interval=given.interval, truth=given.truth)

    def hidden(keys: tuple[str, ...]) -> list[Job]:
        return [
            replace(one, keys=(term(k).key,), size=s, seed=n)
            for k in keys
            for s in SIZES
            for n in seeds(seed, k, s, n=given.robots)
        ]

    none = [replace(one, seed=n) for n in seeds(seed, "none", n=given.none)]
    jobs, scale = hidden(EFFECTS) + none, hidden(SCALE)
    began = time.perf_counter()
    done = run_all(jobs + scale, given.processes, journal)
    seconds = time.perf_counter() - began
    out = report(titled("diffdrive", given.truth), done[: len(jobs)], needed)
    print("\nthe scale of both encoders, which wheels and drags may have, too")
    out["scale"] = report("diffdrive, encoder_scale", done[len(jobs) :], needed)
    out["seconds"]["all"] = seconds
    print(f"{len(done)} diagnoses in {seconds:.0f} s")
    write("naming_wheels.json" if given.truth == "own" else "naming_wheels_independent.json", out, given)


if __name__ == "__main__":
    main()
