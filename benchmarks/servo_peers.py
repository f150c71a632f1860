"""The tools beside which the servo bench's diagnosis is put: each is told its structure, and names no cause.

`ladder`: CMA-ES (library `cma`) on a rung of the published friction ladder in the joint engine, by the very error
that is reported. `identify`: mujoco.sysid, its parameters and its optimiser, on rollouts of the mujoco engine;
states are compared themselves, each window counts by its length.
"""

import time
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO

import numpy as np

from dynreg.diagnose.fit import bounds
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.diagnose.problem import Point, Problem, Spent
from dynreg.sim.effects import term

LADDER = {"M1": (), "M3": ("load_friction",), "M4": ("stribeck_load_friction",)}
POPULATION = 30
ITERATIONS = 30  # of mujoco.sysid


@dataclass(frozen=True)
class Peer:
    """What a peer came to: mean absolute errors of position [rad] on its training runs and on those held out."""

    name: str
    train: float
    held_out: float
    evaluations: int
    seconds: float


def ladder(
    problem: Problem, rung: str, train: np.ndarray, test: np.ndarray, *, seed: int, budget: int
) -> Peer:
    """CMA-ES on one rung: the robot's own parameters and the rung's, all within their bounds, no prior."""
    import cma

    began = time.perf_counter()
    hypothesis = Hypothesis(tuple(term(key) for key in LADDER[rung]))
    many = len(problem.coordinates)
    start = Point(hypothesis, np.zeros(many), np.ones(len(hypothesis.parameters)))
    low, high = bounds(problem, start).T
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
        search.tell(asked, errors(problem, [point(x) for x in asked], train).tolist())
    best = [point(search.result.xbest)]
    seconds = time.perf_counter() - began
    return Peer(
        f"CMA-ES {rung}, seed {seed}",
        float(errors(problem, best, train)[0]),
        float(errors(problem, best, test)[0]),
        int(search.result.evaluations),
        seconds,
    )


def identify(problem: Problem, train: np.ndarray, test: np.ndarray) -> Peer | None:
    """mujoco.sysid from the nameplate: mass, torque constant, resistance, inertia, friction, damping and offset.

    None, with one line, where what it needs beside the mujoco wheel is not installed.
    """
    from mujoco import sysid

    if not hasattr(sysid, "ParameterDict"):
        print("mujoco.sysid: skipped, what it needs is not installed (pip install 'mujoco[sysid]')")
        return None
    began = time.perf_counter()
    problem = replace(problem, engine="mujoco", spent=Spent())
    space = [problem.robot.space.parameters[i] for i in problem.coordinates.free]
    parameters = sysid.ParameterDict()
    for p in space:
        parameters.add(sysid.Parameter(p.name, p.nominal, p.low, p.high))

    def points(x: np.ndarray) -> list[Point]:
        full = np.tile(problem.coordinates.centre, (x.shape[1], 1))
        full[:, problem.coordinates.free] = x.T
        return [Point(Hypothesis(), z, np.zeros(0)) for z in problem.coordinates.from_values(full)]

    def residual(x: np.ndarray, _params):
        columns = np.asarray(x).reshape(len(space), -1)
        left = np.nan_to_num(problem.residuals(points(columns), train)).reshape(columns.shape[1], -1).T
        return [left if np.ndim(x) == 2 else left[:, 0]], None, None

    scale = np.array([p.high - p.low for p in space])
    with redirect_stdout(StringIO()):  # its optimiser tells every iteration
        fitted, _ = sysid.optimize(
            parameters, residual, optimizer="mujoco", verbose=False, x_scale=scale, max_iters=ITERATIONS
        )
    best = points(fitted.as_vector()[:, None])
    evaluations, seconds = problem.spent.candidates, time.perf_counter() - began
    return Peer(
        "mujoco.sysid",
        float(errors(problem, best, train)[0]),
        float(errors(problem, best, test)[0]),
        evaluations,
        seconds,
    )


def errors(problem: Problem, points: list[Point], windows: np.ndarray) -> np.ndarray:
    """(n,) mean absolute error of the first channel over `windows`, in its unit."""
    states = problem.states(points, windows)[:, :, 1:, 0]
    miss = np.abs(states - problem.windows.measured[windows][:, 1:, 0])
    return np.nanmean(np.where(np.isfinite(miss), miss, 10.0), axis=(1, 2))
