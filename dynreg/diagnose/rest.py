"""What the best simulator leaves of each joint's acceleration, and which signals of the joint tell it."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.leftover import Leftover, leftover
from dynreg.diagnose.one_step import one_step_residuals, one_step_run, predictions
from dynreg.diagnose.problem import Point, Problem
from dynreg.diagnose.signals import joint_of_channel, joints_of_actions
from dynreg.results.diagnosis import ResidualShare, Rest, Verdict

LONGEST_LEAD = 10  # commands: farther from a measured row the simulation is no longer where the robot was


def rest(
    problem: Problem, point: Point, chosen: np.ndarray, verdict: Verdict, seed: int = 0
) -> tuple[tuple[Rest, ...], tuple[ResidualShare, ...]] | None:
    """How much of what `point` leaves in the windows `chosen` can be told, and by which signals of each joint.

    None where the verdict is that nothing is left, or where the log does not say from which states to start.
    """
    if verdict not in ("partly_explained", "unknown") or not _startable(problem):
        return None
    found = [leftover(r, seed=seed) for r in _residuals(problem, point, chosen)]
    if not found:
        return None
    found.sort(key=lambda each: -each.explained)
    return tuple(map(_rest, found)), tuple(
        ResidualShare(joint=row.joint, signal=row.signal, share=row.share)
        for each in found
        for row in each.rows
    )


def _residuals(problem: Problem, point: Point, chosen: np.ndarray):
    robot, windows = problem.robot, problem.windows.take(chosen)
    run = one_step_run(robot, windows, _lead(problem, point))
    ahead = Problem(
        robot, replace(windows, run=run), problem.coordinates, problem.engine, problem.threads
    ).states([point], np.arange(run.episodes))[0]
    return one_step_residuals(robot, windows, predictions(robot, windows, ahead))


def _lead(problem: Problem, point: Point) -> int:
    """Commands that the point's delays and lags remember."""
    values = problem.coordinates.effect_values(point.hypothesis, point.effect[None])
    remembered = [
        float(v)
        for term, row in zip(point.hypothesis.terms, values, strict=True)
        for p, v in zip(term.effect.parameters, row[0], strict=True)
        if p.unit == "s"
    ]
    return min(int(np.ceil(sum(remembered) / problem.windows.period)), LONGEST_LEAD)


def _startable(problem: Problem) -> bool:
    """Whether all of the state that no driven joint has (a floating base, a passive joint) was measured."""
    robot, measured = problem.robot, problem.windows.measured
    joints = joints_of_actions(robot)
    other = [i for i, name in enumerate(robot.channels) if joint_of_channel(name, joints) is None]
    return bool(np.isfinite(measured[..., other]).any(axis=(0, 1)).all())


def _rest(found: Leftover) -> Rest:
    return Rest(
        joint=found.joint,
        unit=found.unit,
        left=found.size,
        told=found.explained,
        chance=found.null,
        samples=found.samples,
        trajectories=found.trajectories,
    )
