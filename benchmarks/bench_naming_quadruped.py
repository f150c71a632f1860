"""Hidden effects on a quadruped that stands and walks, its base measured: which effect, and in which joint.

The robot's parts were weighed and measured (`KNOWN`), which the population's ranges leave open. Logs hold standing
episodes and episodes of a trot, 7 s to fit, the same again to select, 3 s to test; each begins at the settled
stance. Robots that are reported were never used in development (`REPORT`). The truth runs with a time step ten
times finer, nameplate errors, a torque disturbance, sensor noise and quantisation. The threshold comes from robots
without an effect of other seeds.
"""

from dataclasses import replace

from measured_quadruped import measured
from naming import TUNE, Job, arguments, journal_of, report, run_all, seeds, threshold, write
from quadruped_trials import EFFECTS, hidden, plan_of

from dynreg.sim.robot import load_robot

REPORT = 20261226


def main() -> None:
    """Print the table and write benchmarks/results/naming_quadruped.json."""
    parser = arguments(__doc__, none=20, threshold_runs=20)
    parser.add_argument("--each", type=int, default=5, help="robots for each effect")
    parser.add_argument("--only", nargs="*", default=list(EFFECTS))
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    robot = measured(load_robot("quadruped"))
    plan = plan_of(robot)
    journal = journal_of(given, robot, seed)
    needed = threshold("quadruped", robot, plan, given, journal)
    none = Job(robot, plan, (), None, 0, needed, interval=given.interval)
    chosen = [h for h in hidden(robot, given.each, seed) if h[0].split("[")[0] in given.only]
    jobs = [replace(none, keys=(k,), size=s, seed=n) for k, s, n in chosen]
    jobs += [replace(none, seed=n) for n in seeds(seed, "none", n=given.none)]
    write(
        "naming_quadruped.json",
        report("quadruped", run_all(jobs, given.processes, journal), needed),
        given,
    )


if __name__ == "__main__":
    main()
