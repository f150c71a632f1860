"""The tools beside which a diagnosis is put, on its own windows: each is told its structure, and names no cause.

`searched`: CMA-ES (library `cma`) on the robot's parameters and the effects that it is told, by the very error that is
reported; `ladder`: the same on a rung of the published friction ladder. `identify`: mujoco.sysid, its parameters and
its optimiser, on rollouts of the mujoco engine; states are compared themselves, each window counts by its length.
"""

import time
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO

import numpy as np

from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds
from dynreg.replay.judged import channel_errors
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot

LADDER = {"M1": (), "M3": ("load_friction",), "M4": ("stribeck_load_friction",)}
POPULATION = 30
ITERATIONS = 30  # of mujoco.sysid
PLACES = ("position", "x", "y")
LOST = 10.0  # rad, m: where a simulator that broke down is said to be


@dataclass(frozen=True)
class Peer:
    """What a peer came to: mean absolute errors of position [rad] on its training runs and on those held out."""

    name: str
    train: float
    held_out: float
    evaluations: int
    seconds: float


def ladder(
    model: Model, data: Data, rung: str, train: np.ndarray, test: np.ndarray, *, seed: int, budget: int
) -> Peer:
    """CMA-ES on one rung of the friction ladder; see `searched`."""
    return searched(model, data, LADDER[rung], train, test, seed=seed, budget=budget, name=f"CMA-ES {rung}")


def searched(
    model: Model,
    data: Data,
    effects: tuple[str, ...],
    train: np.ndarray,
    test: np.ndarray,
    *,
    seed: int,
    budget: int,
    name: str = "CMA-ES",
) -> Peer:
    """CMA-ES on the robot's own parameters and the terms `effects`, all within their bounds, no prior."""
    import cma

    began = time.perf_counter()
    hypothesis = Hypothesis(tuple(term(key) for key in effects))
    many = len(model.coordinates)
    start = Point(hypothesis, np.zeros(many), np.ones(len(hypothesis.parameters)))
    low, high = bounds(model.coordinates, hypothesis).T
    point = lambda x: start.moved(low + x * (high - low))  # noqa: E731
    options = {
        "bounds": [0.0, 1.0],
        "seed": seed + 1,
        "verbose": -9,
        "popsize": POPULATION,
        "maxfevals": budget,
    }
    search = cma.CMAEvolutionStrategy((start.z - low) / (high - low), 0.2, options)
    while not search.stop():
        asked = search.ask()
        search.tell(asked, errors(model, data, [point(x) for x in asked], train).tolist())
    best = [point(search.result.xbest)]
    seconds = time.perf_counter() - began
    return Peer(
        f"{name}, seed {seed}",
        float(errors(model, data, best, train)[0]),
        float(errors(model, data, best, test)[0]),
        int(search.result.evaluations),
        seconds,
    )


def identify(model: Model, data: Data, train: np.ndarray, test: np.ndarray) -> Peer | None:
    """mujoco.sysid from the nameplate: mass, torque constant, resistance, inertia, friction, damping and offset.

    None, with one line, where what it needs beside the mujoco wheel is not installed.
    """
    from mujoco import sysid

    if not hasattr(sysid, "ParameterDict"):
        print("mujoco.sysid: skipped, what it needs is not installed (pip install 'mujoco[sysid]')")
        return None
    began = time.perf_counter()
    model, sample, evaluations = replace(model, engine="mujoco"), data.sample(train), 0
    coordinates = model.coordinates
    space = [model.robot.space.parameters[i] for i in coordinates.free]
    parameters = sysid.ParameterDict()
    for p in space:
        parameters.add(sysid.Parameter(p.name, p.nominal, p.low, p.high))

    def points(x: np.ndarray) -> list[Point]:
        full = np.tile(coordinates.centre, (x.shape[1], 1))
        full[:, coordinates.free] = x.T
        return [Point(Hypothesis(), z, np.zeros(0)) for z in coordinates.from_values(full)]

    def residual(x: np.ndarray, _params):
        nonlocal evaluations
        columns = np.asarray(x).reshape(len(space), -1)
        evaluations += columns.shape[1]
        left = run(model.residuals(points(columns), sample))
        left = np.nan_to_num(left).reshape(columns.shape[1], -1).T
        return [left if np.ndim(x) == 2 else left[:, 0]], None, None

    scale = np.array([p.high - p.low for p in space])
    with redirect_stdout(StringIO()):  # its optimiser tells every iteration
        fitted, _ = sysid.optimize(
            parameters, residual, optimizer="mujoco", verbose=False, x_scale=scale, max_iters=ITERATIONS
        )
    best = points(fitted.as_vector()[:, None])
    seconds = time.perf_counter() - began
    return Peer(
        "mujoco.sysid",
        float(errors(model, data, best, train)[0]),
        float(errors(model, data, best, test)[0]),
        evaluations,
        seconds,
    )


def positions(robot: Robot, data: Data) -> np.ndarray:
    """(C,) columns of the channels that say where the robot is: its joints' positions, or its base's x and y."""
    return np.array([c for c in data.use if robot.channels[c].rsplit("/", 1)[-1] in PLACES])


def errors(model: Model, data: Data, points: list[Point], windows: np.ndarray) -> np.ndarray:
    """(n,) mean absolute error over `windows`, of the mean over `positions`, in their unit."""
    states = run(model.states(points, data.windows.run.take(windows)))
    return missed(model.robot, data, states, windows)


def missed(robot: Robot, data: Data, states: np.ndarray, windows: np.ndarray) -> np.ndarray:
    """(n,) the same of states (n, W, T+1, S); what is no number errs by `LOST`."""
    finite = np.where(np.isfinite(states), states, LOST)
    return channel_errors(data.windows, finite, windows)[:, positions(robot, data)].mean(axis=1)
