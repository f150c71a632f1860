"""What the best simulator leaves of each joint's acceleration, and which signals of the joint tell it."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.evidence import Verdict
from dynreg.diagnose.leftover import Leftover, leftover
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
) -> tuple[Leftover, ...] | None:
    """How much of what `point` leaves in the windows `chosen` can be told, and by which signals; of each joint.

    None where the verdict is that nothing is left, or where the log does not say from which states to start.
    """
    robot, windows = problem.robot, problem.windows.take(chosen)
    joints = joints_of_actions(robot)
    # of no driven joint: of a floating base, of a passive joint
    other = [i for i, name in enumerate(robot.channels) if joint_of_channel(name, joints) is None]
    measured = np.isfinite(problem.windows.measured[..., other]).any(axis=(0, 1)).all()
    if verdict not in ("partly_explained", "unknown") or not measured:
        return None
    values = problem.coordinates.effect_values(point.hypothesis, point.effect[None])
    delays = [
        float(v)
        for term, row in zip(point.hypothesis.terms, values, strict=True)
        for p, v in zip(term.effect.parameters, row[0], strict=True)
        if p.unit == "s"
    ]
    lead = min(int(np.ceil(sum(delays) / windows.period)), LONGEST_LEAD)
    run = one_step_run(robot, windows, lead)
    cut = replace(windows, run=run)
    ahead = Problem(robot, cut, problem.coordinates, problem.engine, problem.threads)
    states = ahead.states([point], np.arange(run.episodes))[0]
    found = [
        leftover(r, seed=seed)
        for r in one_step_residuals(robot, windows, predictions(robot, windows, states))
    ]
    return tuple(sorted(found, key=lambda each: -each.explained)) or None
