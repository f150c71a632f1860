"""Zeros: how far each episode's positions are off, where encoders are set to zero anew at every start.

Dry friction leaves a robot anywhere within its band when it is set to zero by hand: a constant torque in every
rollout of that episode, and another one in the next. No cause can make up for it, and it hides the small ones. What
all episodes have in common is left to the causes (`encoder_offset`, for one).
"""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.problem import Point, Problem, mean_squares
from dynreg.replay.windows import Windows

ROUNDS = 4  # of Gauss-Newton
STEP = 0.4  # standard deviations of the zero, to either side, for derivatives


def rezeroed(problem: Problem, raw: Windows, point: Point, chosen: np.ndarray) -> Windows:
    """`raw` with the positions of each episode moved to where `point` explains its windows `chosen` best.

    Maximum a posteriori with the standard deviation that robot.toml states as the channel's `zero`; windows as they
    are where it states none. Episodes without chosen windows stay as they are.
    """
    sigma = np.array([c.zero for c in problem.robot.file.channels])
    columns = np.flatnonzero((sigma > 0) & np.isfinite(raw.run.initial[chosen]).all(axis=0))
    if not len(columns):
        return raw
    problem = replace(problem, whole=True)  # a zero is one of a whole episode
    groups = [raw.episode == e for e in np.unique(raw.episode[chosen])]
    off = np.zeros((len(raw), len(columns)))  # in standard deviations
    moved = lambda off: _moved(raw, columns, off * sigma[columns])  # noqa: E731
    residual, cost = _measure(problem, moved(off), point, chosen, None)
    effective = problem.effective(residual)
    _, cost = _measure(problem, moved(off), point, chosen, effective)
    for _ in range(ROUNDS):
        slopes = []
        for k in range(len(columns)):
            step = STEP * np.eye(len(columns))[k]
            ends = [_measure(problem, moved(off + s * step), point, chosen, None)[0] for s in (1, -1)]
            slopes.append((ends[0] - ends[1]) / (2 * STEP))
        weight = effective / mean_squares(residual[None], problem.floor)[0]
        tried = off.copy()
        for group in groups:
            own = group[chosen]
            step = _step(residual[own], np.array(slopes)[:, own], weight[own], off[group][0])
            tried[group] += np.clip(step, -1.0, 1.0)
        made, price = _measure(problem, moved(tried), point, chosen, effective)
        for group in groups:
            own = group[chosen]
            gain = cost[own].sum() - price[own].sum()
            if gain > 0.5 * (tried[group][0] @ tried[group][0] - off[group][0] @ off[group][0]):
                off[group] = tried[group]
                residual[own], cost[own] = made[own], price[own]
    common = np.mean([off[group][0] for group in groups], axis=0)
    for group in groups:
        off[group] -= common
    return moved(off)


def _moved(raw: Windows, columns: np.ndarray, by: np.ndarray) -> Windows:
    """Windows with the channels `columns` moved: by (W, K), in their unit."""
    measured, initial = raw.measured.copy(), raw.run.initial.copy()
    measured[..., columns] += by[:, None]
    initial[:, columns] += by
    return replace(raw, measured=measured, run=replace(raw.run, initial=initial))


def _measure(
    problem: Problem, windows: Windows, point: Point, chosen: np.ndarray, effective: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Residual (W, T, C) of `point` in other windows than the problem's, and its cost (W,) in each [nats].

    The cost is 0 without `effective` (W, C), the independent samples of each channel.
    """
    residual = replace(problem, windows=windows).residuals([point], chosen)[0]
    if effective is None:
        return residual, np.zeros(len(chosen))
    squares = mean_squares(residual[None], problem.floor)[0]
    return residual, 0.5 * np.nansum(effective * np.log(squares), axis=1)


def _step(residual: np.ndarray, slopes: np.ndarray, weight: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(K,) Gauss-Newton step of one episode's zeros, in standard deviations.

    residual : (W, T, C). slopes : (K, W, T, C). weight : (W, C) of a window's mean square.
    """
    known = np.isfinite(residual)
    weights = np.nan_to_num(weight)[:, None] * known / np.maximum(known.sum(axis=1, keepdims=True), 1)
    j = np.nan_to_num(slopes)
    curvature = np.einsum("kwtc,wtc,lwtc->kl", j, weights, j) + np.eye(len(off))
    downhill = -np.einsum("kwtc,wtc,wtc->k", j, weights, np.nan_to_num(residual)) - off
    return np.linalg.solve(curvature, downhill)
