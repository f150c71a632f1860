"""Trials of a quadruped that stands and walks: its commands, and the effects that its robots hide."""

import numpy as np
from naming import TUNE

from dynreg.evidence.truth import Protocol
from dynreg.rng import stream, stream_seed
from dynreg.sim.excitation import KINDS, reset_pose
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

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
STEPS = 60  # of an episode: 1.7 s
UP = {"_shoulder": 0.45, "_elbow": -0.8}  # rad
RISING = 0.4  # s
SWAY = 0.07  # rad, of each joint on its own
PUSH = {"_hip": 0.18, "_shoulder": 0.09}  # rad, of these joints of all legs together: sideways, and ahead


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


def plan_of(robot: Robot, held: int = 0) -> Protocol:
    """The commands of all trials: stand, trot, stand, trot to fit, the same to select; one of each to test.

    held : so many of each to test, other ones. A single trial tells little: where a foot slips half a time step
    earlier, the robot ends up elsewhere.
    """
    kinds = ("levels", "chirp", "levels")
    stands = [stand(robot, stream(TUNE, "stand", i), kind) for i, kind in enumerate(kinds)]
    trots = [trot(robot, stream(TUNE, "trot", i), way) for i, way in enumerate((1.0, -1.0, 1.0))]
    fits = [stands[0], trots[0], stands[1], trots[1]]
    names = [f"{part}_{i}" for part in ("fit", "select") for i in range(4)]
    tests = {"test_0": stands[2], "test_1": trots[2]}
    if held:
        tests = {}
        for i in range(held):
            tests[f"test_stand_{i}"] = stand(robot, stream(TUNE, "held stand", i), "levels")
            tests[f"test_trot_{i}"] = trot(robot, stream(TUNE, "held trot", i), (-1.0) ** i)
    actions = np.array([*fits, *fits, *tests.values()])
    names = [*names, *tests]
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
