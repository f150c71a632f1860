"""Hidden effects on a quadruped that stands and walks, its base measured: which effect, and in which joint.

The robot's parts were weighed and measured (`KNOWN`), which the population's ranges leave open. Logs hold standing
episodes and episodes of a trot, 7 s to fit, the same again to select, 3 s to test; each begins at the settled
stance. Robots that are reported were never used in development (`REPORT`). The truth runs with a time step ten
times finer, nameplate errors, a torque disturbance, sensor noise and quantisation. The threshold comes from robots
without an effect of other seeds.
"""

from dataclasses import replace

import numpy as np
from naming import TUNE, Job, arguments, journal_of, report, run_all, seeds, threshold, write

from dynreg.evidence.truth import Protocol
from dynreg.rng import stream, stream_seed
from dynreg.sim.excitation import KINDS, reset_pose
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.space import ParameterSpace

REPORT = 20261226
SIZES = ("medium", "strong")
EFFECTS = (
    "payload",
    "torque_limit",
    "ground_friction",
    "second_friction_material",
    "contact_compliance",
    "command_delay",
    "backlash",
    "gravity_tilt",
    "voltage_sag",
    "imu_misalignment",
)
IN_ONE_JOINT = ("torque_limit", "backlash")
# 1 sigma of what scales, rulers, a pull on the standing robot and the controller's own file tell
KNOWN = {
    "friction": 0.03,
    "torque": 0.02,
    "joint_speed": 0.05,
    "joint_limits": 0.01,
    "largest_step": 0.01,
    "upper_length": 0.01,
    "lower_length": 0.01,
    "torso_mass": 0.02,
    "leg_mass": 0.02,
    "inertia": 0.2,
    "gravity": 0.001,
}
TORQUE = 2.0  # N m: with less the robot topples as soon as it carries more or a servo is weaker
STEPS = 60  # of an episode: 1.7 s
UP = {"_shoulder": 0.45, "_elbow": -0.8}  # rad
RISING = 0.4  # s
SWAY = 0.07  # rad, of each joint on its own
PUSH = {"_hip": 0.18, "_shoulder": 0.09}  # rad, of these joints of all legs together: sideways, and ahead


def measured(robot: Robot) -> Robot:
    """The robot with its parameters known as well as `KNOWN` says, and with servos that carry it when it walks."""
    space = tuple(replace(p, tolerance=KNOWN.get(p.name, p.tolerance)) for p in robot.space.parameters)
    space = tuple(replace(p, nominal=TORQUE) if p.name == "torque" else p for p in space)
    # the heading drifts as feet slip: what it does after a second is chance
    channels = [
        c.model_copy(update={"weight": 0.0}) if c.name == "base/yaw" else c for c in robot.file.channels
    ]
    file = robot.file.model_copy(update={"channels": channels})
    return replace(robot, space=ParameterSpace(space), file=file)


def risen(robot: Robot) -> np.ndarray:
    """(T, A) commands that rise from the stance, in which two legs cannot carry the robot, to straighter legs."""
    t = np.arange(STEPS)[:, None] / robot.rate
    low = reset_pose(robot)
    high = [
        next((v for part, v in UP.items() if part in a), h) for a, h in zip(robot.actions, low, strict=True)
    ]
    return low + np.minimum(t / RISING, 1.0) * (np.array(high) - low)


def stand(robot: Robot, rng: np.random.Generator, kind: str) -> np.ndarray:
    """(T, A) commands: the joints move a little, each on its own, and the legs together push the body to and fro.

    What joints do on their own is little, for the feet hold each other; only the whole body's mass asks drives for
    all of their torque, the supply for current, and the ground for its friction.
    """
    t = np.arange(STEPS)[:, None] / robot.rate
    own, pushes = (KINDS[kind](rng, STEPS, n, robot.rate) for n in (12, len(PUSH)))
    out = SWAY * own
    for (part, reach), push in zip(PUSH.items(), pushes.T, strict=True):
        out[:, [part in a for a in robot.actions]] += reach * push[:, None]
    return risen(robot) + np.minimum(t / RISING, 1.0) * out


def trot(robot: Robot, rng: np.random.Generator, way: float) -> np.ndarray:
    """(T, A) commands: diagonal legs swing together and lift their feet, forward (`way` 1) or backward (-1)."""
    t = np.arange(STEPS) / robot.rate
    ramp = np.clip((t - RISING) / 0.2, 0.0, 1.0)
    swing, lift, beat = rng.uniform(0.05, 0.08) * way, rng.uniform(0.1, 0.18), rng.uniform(1.8, 2.3)
    out = risen(robot)
    for a, action in enumerate(robot.actions):
        phase = 2 * np.pi * beat * t + (0.0 if action[:2] in ("fl", "rr") else np.pi)
        up = lift * np.maximum(np.cos(phase), 0.0)
        if "_shoulder" in action:
            out[:, a] += ramp * (0.5 * up - swing * np.sin(phase))
        elif "_elbow" in action:
            out[:, a] -= ramp * up
    return out


def plan_of(robot: Robot) -> Protocol:
    """The commands of all trials: stand, trot, stand, trot to fit, the same to select; one of each to test."""
    kinds = ("levels", "chirp", "levels")
    stands = [stand(robot, stream(TUNE, "stand", i), kind) for i, kind in enumerate(kinds)]
    trots = [trot(robot, stream(TUNE, "trot", i), way) for i, way in enumerate((1.0, -1.0, 1.0))]
    fits = [stands[0], trots[0], stands[1], trots[1]]
    actions = np.array([*fits, *fits, stands[2], trots[2]])
    names = [f"{part}_{i}" for part, many in (("fit", 4), ("select", 4), ("test", 2)) for i in range(many)]
    begin = np.arange(len(actions)) * (STEPS + 1) / robot.rate
    return Protocol(Run(actions, period=1.0 / robot.rate, begin=begin), tuple(names))


def hidden(robot: Robot, each: int, seed: int) -> list[tuple[str, str, int]]:
    """(effect and joint, size, seed of the robot) of the trials: every effect `each` times."""
    out = []
    for i in range(each):
        for n, effect in enumerate(EFFECTS):
            joint = stream(seed, "joint", effect, i).choice([a.split("/")[0] for a in robot.actions])
            key = f"{effect}[{joint}]" if effect in IN_ONE_JOINT else effect
            out.append((key, SIZES[(n + i) % 2], stream_seed(seed, "quadruped", effect, i) % 2**31))
    return out


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
