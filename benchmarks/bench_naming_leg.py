"""Hidden effects on a leg of three joints, in the air and on the ground: which effect, and in which joint.

An effect is drawn, then the joint that it sits in (effects of the whole robot sit in none); the robots that are
reported were never used in development (`REPORT`). The truth runs with a time step ten times finer, nameplate
errors, a torque disturbance, sensor noise and quantisation. The threshold comes from robots without an effect of
other seeds. 16 s a log: 6 to fit, 6 to select, 4 to test.
"""

import json
from dataclasses import replace

import numpy as np
from naming import RESULTS, TUNE, Job, arguments, journal_of, report, run_all, seeds, threshold, write

from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.truth import Protocol, protocol
from dynreg.rng import stream, stream_seed
from dynreg.sim.robot import Robot, load_robot

REPORT = 20261130
HEIGHTS = {"air": 0.5, "ground": 0.2}  # m of the rail's lower stop
SIZES = ("medium", "strong")
KINDS = ["levels", "chirp", "triangle"]
REACH = {"air": 1.0, "ground": 1.0}  # of the robot's own excitation


def plan_of(robot: Robot, where: str) -> Protocol:
    """The commands of all trials in the air or on the ground: large motions, the drives always on."""
    table = robot.file.excitation.model_copy(update={"kinds": KINDS})
    lively = replace(robot, file=robot.file.model_copy(update={"excitation": table}))
    plan = protocol(lively, seed=TUNE, seconds=15.0, episode=2.0, reach=REACH[where])
    return replace(plan, run=replace(plan.run, settings=np.full_like(plan.run.settings, HEIGHTS[where])))


def drawn(robot: Robot, where: str, many: int, seed: int) -> list[tuple[str, str, int]]:
    """(effect and joint, size, seed of the robot) of the trials; nothing that needs the ground in the air."""
    terms = [t for t in single_terms(robot) if where == "ground" or t.effect.acts_on != "contact"]
    effects = list(dict.fromkeys(t.effect.id for t in terms))
    rng, order, out = stream(seed, "leg", where), [], []
    for i in range(many):
        if not order:
            order = list(rng.permutation(effects))  # every effect once before any comes again
        own = [t.key for t in terms if t.effect.id == order[-1]]
        order.pop()
        key = str(rng.choice(own[1:] or own))  # the first sits in all joints
        out.append((key, SIZES[i % 2], stream_seed(seed, "leg", where, i) % 2**31))
    return out


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
