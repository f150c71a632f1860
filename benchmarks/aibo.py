"""A hidden AIBO and its logs for paper E: joints in the air, motions on the ground, and walks, bad ones included."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.gait.space import gait_space
from dynreg.rng import stream
from dynreg.sim.effects import Term, Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import command_limits, reset_pose
from dynreg.sim.real import disturbance, disturbed, drive_limits, finer, sensed
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.space import ParameterSpace

SHARE = 0.8  # of a joint's way, as in the paper
AIR = 60.0  # s: half a sine of rising frequency, half a square wave
SLOWEST, FASTEST, SQUARE = 0.2, 1.5, 0.5  # Hz
WALK = 5.0  # s
FIT, HELD = 40, 20  # walks of groups A and B
SPREAD = 0.7  # of the nameplate's tolerance, 1 sigma, by which hidden parameters differ from nominal
SHORTEST = 2.0  # s of a walk that is kept
ON_ELBOWS, BACK = 0.75, 1 / 3  # shares of the walks
# Shares of their ranges in which genes are drawn, of the walks on elbows alone or of all.
RANGES = (
    (("length", "speed"), (0.3, 1.0), False),
    (("front_z",), (0.85, 1.0), True),
    (("front_x",), (0.7, 1.0), True),
    (("rear_z",), (0.5, 0.8), True),
)
LOSS = 0.6  # of the elbows' friction


@dataclass(frozen=True, eq=False)
class Hidden:
    """A robot: parameters {name: value}, and whether its elbows are more slippery than its paws."""

    seed: int
    parameters: dict[str, float]
    material: bool

    def values(self, space: ParameterSpace) -> np.ndarray:
        """(P,) of those that the robot has, on its feet or on its stand."""
        return space.from_dict({name: self.parameters[name] for name in space.names})

    def effects(self, robot: Robot) -> tuple[tuple[Term, ...], tuple[np.ndarray, ...]]:
        """What it has beside its parameters."""
        if not (self.material and robot.floating):
            return (), ()
        return (term("second_friction_material[elbow]"),), (np.array([LOSS]),)


def hidden(seed: int, *, material: bool = True) -> Hidden:
    """A robot that differs from the nameplate by its tolerances."""
    space, rng = load_robot("aibo").space, stream(seed, "hidden aibo")
    share = np.array([p.tolerance for p in space.parameters])
    log = np.array([p.scale == "log" for p in space.parameters])
    draw = SPREAD * share * rng.standard_normal(len(space))
    values = np.where(log, space.nominal * np.exp(draw), space.nominal + draw)
    inside = space.from_unit(np.clip(space.to_unit(values), 0.02, 0.98))
    return Hidden(seed, space.as_dict(inside), material)


def in_the_air(robot: Robot, seconds: float = AIR) -> np.ndarray:
    """(T, A) commands of a robot on its stand: all joints at once, each with a phase of its own."""
    rate = robot.rate
    time = np.arange(round(0.5 * seconds * rate)) / rate
    low, high = command_limits(robot).T
    middle, reach = 0.5 * (low + high), 0.5 * SHARE * (high - low)
    phase = 2 * np.pi * np.arange(len(low)) / len(low)
    turned = 2 * np.pi * (SLOWEST * time + 0.5 * (FASTEST - SLOWEST) * time**2 / time[-1])
    sine = np.sin(turned[:, None] + phase)
    square = np.sign(np.sin(2 * np.pi * SQUARE * time[:, None] + phase))
    return middle + reach * np.concatenate([sine, square])


def on_the_ground(robot: Robot, seconds: float = WALK) -> dict[str, np.ndarray]:
    """{name: (T, A)} a walk, a kick of a front leg, getting up from the knees, and pushing back and forth."""
    time, rest = np.arange(round(seconds * robot.rate)) / robot.rate, reset_pose(robot)
    at = {name.split("/")[0]: i for i, name in enumerate(robot.actions)}
    out = {name: np.tile(rest, (len(time), 1)) for name in ("kick", "get_up", "push")}
    begun = np.clip(time / 0.5, 0.0, 1.0)
    swing = np.where((time % 2.0) < 1.0, -0.5, 0.7) * begun
    out["kick"][:, at["fr_rotor"]] += swing
    out["kick"][:, at["fr_knee"]] -= 0.5 * np.abs(swing)
    low = 0.5 * begun * (1.0 + np.sign(np.sin(2 * np.pi * 0.5 * time)))
    for leg in ("fl", "fr", "rl", "rr"):
        out["get_up"][:, at[f"{leg}_knee"]] += 0.3 * low
        out["get_up"][:, at[f"{leg}_rotor"]] -= 0.15 * low
        ahead = 1.0 if leg[0] == "f" else -1.0  # a rear leg is a front one, mirrored
        out["push"][:, at[f"{leg}_rotor"]] += ahead * 0.25 * begun * np.sin(2 * np.pi * 0.7 * time)
    return {"walk": walks(robot, 1, 0, seconds)[0], **out}


def walks(robot: Robot, count: int, seed: int, seconds: float = WALK, back: float = BACK) -> np.ndarray:
    """(count, T, A) walks by the way of the feet: ahead and back, in curves, some on the elbows; bad ones stay.

    back : share of those that go backwards. Commands may be faster than the joints, as those of the paper were.
    """
    space, rng = gait_space(robot), stream(seed, "walks")
    unit = space.about_rest(count, rng)
    low = rng.uniform(size=count) < ON_ELBOWS
    for names, (least, most), which in RANGES:
        at = [space.names.index(name) for name in names]
        rows = low if which else np.ones(count, dtype=bool)
        unit[np.ix_(rows, at)] = rng.uniform(least, most, (rows.sum(), len(at)))
    genes = space.from_unit(unit)
    genes[rng.uniform(size=count) < back, space.names.index("length")] *= -1.0
    targets = space.targets(genes, np.arange(round(seconds * robot.rate)) / robot.rate)
    return np.clip(targets, *command_limits(robot).T)


def logged(
    hidden: Hidden,
    robot: Robot,
    commands: dict[str, np.ndarray],
    threads: int = 0,
    shortest: float = SHORTEST,
) -> Recording:
    """What the robot did under commands {name: (T, A)} of one length, from its reset pose each time.

    The truth has a finer time step, disturbances of its own, sensor noise and quantisation, as `SimulatedRobot` has. A
    log ends with a fall, and is left out where that comes in the first `shortest` seconds.
    """
    truth, actions = finer(robot), np.stack([*commands.values()])
    # of the mean limit of all drives, as in the runs of which the tables tell
    limits = np.full(len(robot.actions), drive_limits(robot).mean())
    rng = stream(hidden.seed, "hidden aibo", robot.name, *commands)
    run = disturbed(Run(actions, period=1.0 / robot.rate), limits, rng)
    terms, values = hidden.effects(robot)
    active = Terms(terms, tuple(v[None] for v in values)) + disturbance(truth, limits)
    done = rollout(truth, hidden.values(robot.space)[None], run, terms=active, threads=threads)
    told = np.concatenate([actions, actions[:, -1:]], axis=1)
    table = np.concatenate([sensed(robot, done.states[0], rng), told], axis=-1)
    named = (*robot.file.channels, *robot.file.actions)
    time = np.arange(table.shape[1]) / robot.rate
    episodes = []
    for number, (name, rows, fell) in enumerate(zip(commands, table, done.fell[0], strict=True)):
        last = min(int(fell), len(rows))
        if last >= shortest * robot.rate:
            episodes.append(Episode(name, time[:last] + 100.0 * number, rows[:last]))
    return Recording(tuple(Channel(c.name, c.unit) for c in named), tuple(episodes), measured=False)


def logs(
    robot: Hidden,
    stand: Robot,
    *,
    fit: int = FIT,
    held: int = HELD,
    air: float = AIR,
    walk: float = WALK,
) -> dict[str, Recording]:
    """{"air": of `stand`, aibo on it; "ground": motions, "walks": groups A and B, both of `aibo`}; air, walk : [s]."""
    aibo = load_robot("aibo")
    named = {f"A{i:02}": w for i, w in enumerate(walks(aibo, fit, robot.seed, walk))}
    named |= {f"B{i:02}": w for i, w in enumerate(walks(aibo, held, robot.seed + 1_000_000, walk))}
    return {
        "air": logged(robot, stand, {"air": in_the_air(stand, air)}),
        "ground": logged(robot, aibo, on_the_ground(aibo, walk)),
        "walks": logged(robot, aibo, named),
    }
