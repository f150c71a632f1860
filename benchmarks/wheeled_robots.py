"""Robots on two wheels that hide one systematic effect, the models made of their logs, and what drives plans."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

import dynreg
from dynreg.compare.compare import compare
from dynreg.compare.contenders import Plan as ModelPlan
from dynreg.data.recording import Recording
from dynreg.evidence.truth import Protocol, hide, recorded
from dynreg.rng import stream, stream_seed
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.timed.commands import Commands, drawn
from dynreg.timed.compare import compared
from dynreg.timed.fit import RANGES
from dynreg.timed.models import COARSE, Kinematic, Model, Unicycle
from dynreg.timed.navigation import TICK, Path, Plan, path_along
from dynreg.timed.networks import Networks
from dynreg.timed.unicycle import KHEPERA, unicycle
from dynreg.truths import table as truths
from dynreg.truths.kernels import rolling
from dynreg.truths.truth import Commands as TruthCommands
from dynreg.truths.truth import Truth
from dynreg.truths.wheels import rows_of

COMMANDS = 1460  # 1000 to fit, 230 to validate, 230 to test
EPISODE = 60.0  # s
HELD_OUT = 5  # episodes at the end, which hold the last 230 commands; no diagnosis sees them
SEEN = 12  # episodes that the diagnosis sees
POSE = slice(4, 7)  # x, y and yaw in what a truth says
# {effect: values}: of such a size that the fitted unicycle is off by about the published 4.2 degrees on a command
SIZES: Mapping[str, Mapping[str, float]] = {
    "wheel_gain": {"difference": 0.097},
    "turn_slowdown": {"arm": 0.0122},
    "command_deadband": {"width": 0.56},
    "wheel_slip": {"grip": 1.17},
}
SIGNED = ("wheel_gain",)
NETWORK = ("weights", "mean", "scale", "out_mean", "out_scale", "errors")


def hidden(seed: int, number: int) -> Truth:
    """A robot drawn from its nameplate; four in a row hide four effects, in an order that is drawn."""
    robot = load_robot("diffdrive")
    kinds = stream(seed, "hidden effects", number // len(SIZES)).permutation(list(SIZES))
    cause = str(kinds[number % len(SIZES)])
    own = stream_seed(seed, "hidden wheels", number) % 2**31
    values = dict(SIZES[cause])
    if cause in SIGNED:
        sign = stream(own, "sign").choice([-1.0, 1.0])
        values = {name: float(sign * value) for name, value in values.items()}
    parameters = robot.space.as_dict(hide(robot, (), None, own).parameters)
    return Truth("diffdrive", parameters, cause, values, seed=own)


def log_of(truth: Truth) -> Recording:
    """The robot's log of commands in a row, uniform draws as the paper's, in episodes from standstill."""
    robot = load_robot("diffdrive")
    asked = drawn(COMMANDS, stream(truth.seed, "held commands"))
    ticks = np.round(asked.seconds / TICK).astype(int)
    rows = (
        np.repeat(np.stack([asked.left, asked.right], axis=1), ticks, axis=0) / robot.file.base.wheel_radius
    )
    steps = round(EPISODE / TICK)
    actions = rows[: len(rows) // steps * steps].reshape(-1, steps, 2)
    names = tuple(f"drive_{i:02d}" for i in range(len(actions)))
    run = Run(actions, period=TICK, begin=np.arange(len(actions)) * (steps + 1) * TICK)
    states = truths.log(truth, TruthCommands(run.actions, run.period, run.begin))
    return recorded(robot, Protocol(run, names), states)


def fitted(commands: Commands, moved: np.ndarray, track: float) -> np.ndarray:
    """(6,) the unicycle's parameters for displacements (n, 3), by least squares from those of Table II.

    What the genetic algorithm minimises, and where it ends: `bench_wheeled_ga.py`.
    """
    scale = moved.std(axis=0)

    def off(parameters: np.ndarray) -> np.ndarray:
        return ((unicycle(commands, parameters, track, step=0.02) - moved) / scale).ravel()

    low, high = RANGES.T
    return least_squares(off, KHEPERA, bounds=(low, high), x_scale=np.ptp(RANGES, axis=1)).x


def made(truth: Truth, *, starts: int, threshold_runs: int) -> dict:
    """What a robot's log makes: the models, what a diagnosis names, errors on the last 230 commands."""
    robot, log = load_robot("diffdrive"), log_of(truth)
    seen, last = log.episodes[:SEEN], log.episodes[-HELD_OUT:]
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as session:
        session.registry.put_robot(robot.folder, robot.hash, robot.name)
        part = session.registry.put_recording(replace(log, episodes=(*seen, *last)), robot.hash)
        held = ",".join(e.name for e in last)
        found = session.diagnose(part, hold_out=held, threshold_runs=threshold_runs, threads=1)
        stored = session.registry.simulator(found.extended_simulator or found.calibrated_simulator)
    config = SimConfig.from_dict(stored)
    plan = ModelPlan(("kinematic", "network"), np.inf, starts, 1, seed=truth.seed, threads=1)
    done = compare(robot, log, {"extended": (robot, config)}, plan, {})
    fit, _, test = done.parts
    commands, moved, track = done.told.commands, done.told.moved, done.told.track
    dynamic = fitted(commands.take(fit), moved[fit], track)
    which = np.arange(test.start, test.stop)
    said = {name: contender.moved(which) for name, contender in done.contenders.items()}
    errors = compared(moved[test], said | {"dynamic": unicycle(commands.take(test), dynamic, track)})
    networks = done.contenders["network"].model
    return {
        "hidden": [truth.cause, dict(truth.values)],
        "parameters": dict(truth.parameters),
        "seed": truth.seed,
        "verdict": found.verdict,
        "named": [[c.key, {k: v.value for k, v in c.parameters.items()}] for c in found.causes],
        "extended": stored,
        "dynamic": dynamic.tolist(),
        "network": {field: getattr(networks, field).tolist() for field in NETWORK},
        "commands": errors.commands,
        "errors": {
            name: {axis: [s.mean, s.min, s.max, s.sd] for axis, s in axes.items()}
            for name, axes in errors.models.items()
        },
    }


def truth_of(row: dict) -> Truth:
    """The robot of a row of `made`."""
    cause, values = row["hidden"]
    return Truth("diffdrive", row["parameters"], cause, values, seed=row["seed"])


def simulators_of(row: dict) -> dict[str, "Model | Rolling"]:
    """What plans evolve in: the models of a row of `made`, its extended simulator, and the truth itself.

    The last two by compiled equations in steps of one tick, with the values of each.
    """
    robot = load_robot("diffdrive")
    track, config = robot.file.base.track, SimConfig.from_dict(row["extended"])
    networks = Networks(**{field: np.array(values) for field, values in row["network"].items()})
    return {
        "kinematic": Kinematic(track),
        "dynamic": Unicycle(np.array(row["dynamic"]), track, COARSE),
        "network": networks,
        "extended": Rolling(rows_of(config.values, config.effects)),
        "truth": Rolling(rows_of(row["parameters"], dict([row["hidden"]]))),
    }


def sayers_of(row: dict) -> dict[str, "Model | Extended | Exact"]:
    """What says of the best plans how they end in each simulator: in full resolution, the extended by its engine."""
    robot, config = load_robot("diffdrive"), SimConfig.from_dict(row["extended"])
    return simulators_of(row) | {
        "dynamic": Unicycle(np.array(row["dynamic"]), robot.file.base.track),
        "extended": Extended(robot, config),
        "truth": Exact(truth_of(row)),
    }


def actions_of(plan: Plan) -> list[np.ndarray]:
    """What the wheels of each plan are told at every tick: (T, 2) [rad/s]; at least one tick."""
    radius = load_robot("diffdrive").file.base.wheel_radius
    return [
        rows if len(rows) else np.zeros((1, 2))
        for rows in (plan.speeds(i) / radius for i in range(len(plan.left)))
    ]


def _padded(told: list[np.ndarray]) -> np.ndarray:
    """(B, T + 1, 3) zeros for poses of the longest."""
    return np.zeros((len(told), max(map(len, told)) + 1, 3))


@dataclass(frozen=True, eq=False)
class Rolling:
    """Plans driven by the compiled equations of `dynreg.truths.rolling`, told `rows` (R,) of the robot."""

    rows: np.ndarray

    def drive(self, plan: Plan) -> Path:
        """The paths of B plans."""
        told, go = actions_of(plan), rolling().drive
        poses, begin = _padded(told), np.zeros(7)
        trace = np.empty((poses.shape[1], 7))
        for out, commands in zip(poses, told, strict=True):
            go(self.rows, np.ascontiguousarray(commands), plan.tick, 1, begin, trace[: len(commands) + 1])
            out[: len(commands) + 1] = trace[: len(commands) + 1, POSE]
        return path_along(plan, poses)


@dataclass(frozen=True, eq=False)
class Exact:
    """Plans driven by a hidden robot: `noisy` with what disturbs it and its tracker's noise, else as it would be.

    Every plan has noise of its own, by the robot's seed and `salt`.
    """

    truth: Truth
    noisy: bool = False
    salt: int = 0

    def drive(self, plan: Plan) -> Path:
        """The paths of B plans."""
        told = actions_of(plan)
        poses = _padded(told)
        for number, (out, commands) in enumerate(zip(poses, told, strict=True)):
            own = stream_seed(self.truth.seed, "driven", self.salt, number) % 2**31
            robot = replace(self.truth, exact=not self.noisy, seed=own)
            states = truths.log(robot, TruthCommands(commands[None], plan.tick, np.zeros(1)))
            out[: len(commands) + 1] = states[0][:, POSE]
        return path_along(plan, poses)


@dataclass(frozen=True, eq=False)
class Extended:
    """Plans driven in a simulator of the registry, by its engine."""

    robot: Robot
    config: SimConfig

    def drive(self, plan: Plan) -> Path:
        """The paths of B plans."""
        told = actions_of(plan)
        poses, values = _padded(told), self.robot.space.from_dict(dict(self.config.values))[None]
        actions = np.zeros((len(told), poses.shape[1] - 1, 2))
        for row, commands in zip(actions, told, strict=True):
            row[: len(commands)] = commands
        columns = [self.robot.channels.index(name) for name in ("base/x", "base/y", "base/yaw")]
        run = Run(actions, period=plan.tick, begin=np.zeros(len(told)))
        terms = terms_of(self.config, self.robot)
        states = rollout(self.robot, values, run, engine="unicycle", terms=terms, threads=1).states[0]
        return path_along(plan, states[..., columns])
