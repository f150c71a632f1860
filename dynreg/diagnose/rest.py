"""What the best simulator leaves of each joint's acceleration, and which signals of the joint tell it."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.evidence import Verdict
from dynreg.diagnose.leftover import Leftover, Residuals, leftover
from dynreg.diagnose.one_step import one_step_residuals, one_step_run, predictions
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.signals import joint_of_channel, joints_of_actions

LONGEST_LEAD = 10  # commands: farther from a measured row the simulation is no longer where the robot was


def rest(
    problem: Problem,
    point: Point,
    chosen: np.ndarray,
    verdict: Verdict,
    seed: int = 0,
    longest_lead: int = LONGEST_LEAD,
) -> tuple[Leftover, ...] | None:
    """How much of what `point` leaves in the windows `chosen` can be told, and by which signals; of each joint.

    None where the verdict is that nothing is left, or where the log does not say from which states to start.
    longest_lead : commands that a prediction may start ahead of its row, for the delays of the point.
    """
    if verdict not in ("partly_explained", "unknown") or not _startable(problem):
        return None
    lead = min(_remembered(problem, point), longest_lead)
    found = [leftover(r, seed=seed) for r in _residuals(problem, point, chosen, lead)]
    return tuple(sorted(found, key=lambda each: -each.explained)) or None


def _residuals(problem: Problem, point: Point, chosen: np.ndarray, lead: int) -> list[Residuals]:
    robot, windows = problem.robot, problem.windows.take(chosen)
    run = one_step_run(robot, windows, lead)
    ahead = Problem(
        robot, replace(windows, run=run), problem.coordinates, problem.engine, problem.threads
    ).states([point], np.arange(run.episodes))[0]
    return one_step_residuals(robot, windows, predictions(robot, windows, ahead))


def _remembered(problem: Problem, point: Point) -> int:
    """Commands that the point's delays and lags remember."""
    values = problem.coordinates.effect_values(point.hypothesis, point.effect[None])
    remembered = [
        float(v)
        for term, row in zip(point.hypothesis.terms, values, strict=True)
        for p, v in zip(term.effect.parameters, row[0], strict=True)
        if p.unit == "s"
    ]
    return int(np.ceil(sum(remembered) / problem.windows.period))


def _startable(problem: Problem) -> bool:
    """Whether all of the state that no driven joint has (a floating base, a passive joint) was measured."""
    robot, measured = problem.robot, problem.windows.measured
    joints = joints_of_actions(robot)
    other = [i for i, name in enumerate(robot.channels) if joint_of_channel(name, joints) is None]
    return bool(np.isfinite(measured[..., other]).any(axis=(0, 1)).all())
