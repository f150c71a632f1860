"""The unexplained acceleration of each joint, and the signals of the joint that predict it."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.one_step import one_step_residuals, one_step_run, predictions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.residual_fit import ResidualFit, fit_residual
from dynreg.diagnose.signals import joint_of_channel, joints_of_actions
from dynreg.diagnose.verdict import Verdict
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import NONE

# Half and twice give the same on bench_constants' robots.
LONGEST_LEAD = 10  # commands: with a longer lead the simulation drifts too far from the measured row


def unexplained(found: State, verdict: Verdict, seed: int = 0) -> Search[tuple[ResidualFit, ...] | None]:
    """Fits of the extended simulator's residual acceleration on the fit and select parts, one for each joint.

    The best predicted joint comes first. None if the verdict says that everything is explained, or if the log lacks the
    states from which to start.
    """
    model, data, point = found.model, found.data, found.current
    robot, windows = model.robot, data.windows.take(data.parts.chosen)
    joints = joints_of_actions(robot)
    # channels of no driven joint: of a floating base, of a passive joint
    other = [i for i, name in enumerate(robot.channels) if joint_of_channel(name, joints) is None]
    measured = np.isfinite(data.windows.measured[..., other]).any(axis=(0, 1)).all()
    if verdict not in ("partly_explained", "unknown") or not measured:
        return None
    values = model.coordinates.effect_values(point.hypothesis, point.effect[None])
    delays = [
        float(v)
        for term, row in zip(point.hypothesis.terms, values, strict=True)
        for p, v in zip(term.effect.parameters, row[0], strict=True)
        if p.unit == "s"
    ]
    lead = min(int(np.ceil(sum(delays) / windows.period)), LONGEST_LEAD)
    run = one_step_run(robot, windows, lead)
    (states,) = yield from replace(model, finely=1.0, corrections=NONE).states([point], run)
    left = [
        fit_residual(r, seed=seed)
        for r in one_step_residuals(robot, windows, predictions(robot, windows, states))
    ]
    return tuple(sorted(left, key=lambda each: -each.explained)) or None
