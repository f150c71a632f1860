"""Hidden effects on a leg of three joints, in the air and on the ground: which effect, and in which joint.

An effect is drawn, then the joint that it sits in (effects of the whole robot sit in none); the robots that are
reported were never used in development (`REPORT`). The truth runs with a time step ten times finer, nameplate
errors, a torque disturbance, sensor noise and quantisation. The threshold comes from robots without an effect of
other seeds. 16 s a log: 6 to fit, 6 to select, 4 to test.
"""

import json
from dataclasses import replace

from kept import RESULTS
from leg_trials import HEIGHTS, drawn, plan_of
from naming import TUNE, Job, arguments, journal_of, report, run_all, seeds, threshold, write

from dynreg.sim.robot import load_robot

REPORT = 20261130


def main() -> None:
    """Print the tables and write benchmarks/results/naming_leg.json; a place left out keeps its table there."""
    parser = arguments(__doc__, none=5, threshold_runs=20)
    parser.add_argument(
        "--trials", type=int, default=120, help="robots in the air, and as many on the ground"
    )
    parser.add_argument("--where", nargs="*", default=list(HEIGHTS))
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robot, known = load_robot("leg"), RESULTS / "naming_leg.json"
    documents = json.loads(known.read_text()) if known.exists() else {}
    journal = journal_of(given, robot, seed)
    for where in given.where:
        name, plan = f"leg, {where}", plan_of(robot, where)
        needed = threshold(name, robot, plan, given, journal)
        none = Job(robot, plan, (), None, 0, needed, interval=given.interval)
        jobs = [
            replace(none, keys=(k,), size=s, seed=n) for k, s, n in drawn(robot, where, given.trials, seed)
        ]
        jobs += [replace(none, seed=n) for n in seeds(seed, "leg", where, "none", n=given.none)]
        documents[where] = report(name, run_all(jobs, given.processes, journal), needed)
    write("naming_leg.json", documents, given)


if __name__ == "__main__":
    main()
