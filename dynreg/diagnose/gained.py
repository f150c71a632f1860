"""What simulators leave of the motion on the windows that a diagnosis is judged by, and what its causes take off."""

import numpy as np

from dynreg.diagnose.problem import Problem
from dynreg.diagnose.repeatability import Repeatability
from dynreg.replay import judged as replayed
from dynreg.replay.judged import Gain
from dynreg.replay.residual import scaled
from dynreg.results.diagnosis import RolloutError


def gain(problem: Problem, before: np.ndarray, after: np.ndarray, judged: np.ndarray) -> Gain | None:
    """Share of the error that `after` takes off `before`, states (W, T+1, S) of the windows `judged`."""
    return replayed.gain(*(window_errors(problem, states, judged) for states in (before, after)))


def window_errors(problem: Problem, states: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """(W,) weighted mean absolute error of states (W, T+1, S), in units of the channels' spread."""
    use = problem.use
    measured = problem.windows.measured[judged][:, 1:, use]
    each = np.nanmean(np.abs(scaled(states[:, 1:, use], measured, problem.windows.spread[use])), axis=1)
    return np.nansum(each * problem.windows.weight[use], axis=1)


def channel_errors(
    problem: Problem, states: np.ndarray, judged: np.ndarray, repeats: dict[str, Repeatability], part: str
) -> tuple[RolloutError, ...]:
    """Mean absolute error of every weighted channel: nominal, calibrated and extended are states[0], [1] and [-1]."""
    robot, out = problem.robot, []
    for column in problem.use:
        miss = np.abs(states[:, :, 1:, column] - problem.windows.measured[judged][:, 1:, column])
        mae = [float(np.nanmean(np.where(np.isfinite(m), m, np.nan))) for m in (miss[0], miss[1], miss[-1])]
        known = repeats[robot.channels[column]]
        out.append(
            RolloutError(
                channel=robot.channels[column],
                unit=robot.file.channels[column].unit,
                nominal=mae[0],
                calibrated=mae[1],
                extended=mae[2],
                repeatability=known.spread,
                part=part,
            )
        )
    return tuple(out)


def worst_of(problem: Problem, errors: tuple[RolloutError, ...]) -> RolloutError:
    """The channel that the calibrated simulator has most wrong, in units of its spread."""
    spread = dict(zip(problem.robot.channels, problem.windows.spread, strict=True))
    return max(errors, key=lambda e: (e.calibrated or 0.0) / max(spread[e.channel], 1e-12))
