"""Zeros: the position offset of each episode, for robots whose encoders are zeroed at every start.

Dry friction leaves a robot anywhere within its band when it is zeroed by hand. This acts like a constant torque that
differs from episode to episode. No cause explains it, and it hides small causes. The offset that all episodes share is
left to the causes (for example `encoder_offset`).
"""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.plans.plan import State
from dynreg.evidence.data import Data, Sample
from dynreg.evidence.fit import fit
from dynreg.evidence.likelihood import mean_squares
from dynreg.evidence.lockstep import Search, together
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot

# With these the double pendulum shows its elbow's encoder, 38 nats, and friction (bench_diagnose_double_pendulum).
TURNS = 2  # alternating fits of the zeros and the simulator after each cause
ITERATIONS = 3  # of each fit of the simulator
ROUNDS = 4  # of Gauss-Newton
STEP = 0.4  # standard deviations of the zero, to either side, for derivatives


def zeroed(state: State, posed: Data) -> Search[State]:
    """The state after alternating fits of the episodes' zeros and of the current point.

    posed : the recording with its logged zeros.
    """
    for _ in range(TURNS):
        windows = yield from rezeroed(state.model, posed, state.current, posed.both)
        if windows is posed.windows:  # no encoder is zeroed at the start
            return state
        state = state.on(replace(state.data, windows=windows))
        model = yield from state.model.corrected([state.current], state.data)
        (residual,) = yield from model.residuals([state.current], state.sample)
        (current,), _ = yield from fit(
            model, [state.current], state.sample.reweighted(residual), iterations=ITERATIONS
        )
        state = replace(state, model=model, current=current)
    return state


def rezeroed(model: Model, posed: Data, point: Point, chosen: np.ndarray) -> Search[Windows]:
    """Windows with the positions of each episode shifted so that `point` explains its `chosen` windows best.

    The shift is the maximum a posteriori under the channel's `zero` of robot.toml (a standard deviation). Windows are
    returned unchanged if it states none; episodes without chosen windows stay unchanged.
    """
    raw = posed.windows
    sigma = np.array([c.zero for c in model.robot.file.channels])
    columns = np.flatnonzero((sigma > 0) & np.isfinite(raw.run.initial[chosen]).all(axis=0))
    if not len(columns):
        return raw
    whole = posed.whole.sample(chosen)  # a zero is one of a whole episode
    groups = [raw.episode == e for e in np.unique(raw.episode[chosen])]
    off = np.zeros((len(raw), len(columns)))  # in standard deviations
    moved = lambda off: _moved(raw, columns, off * sigma[columns])  # noqa: E731
    measure = lambda off: _residual(model, moved(off), point, whole)  # noqa: E731
    residual = yield from measure(off)
    whole = whole.reweighted(residual)
    cost = _cost(residual, whole)
    for _ in range(ROUNDS):
        step = STEP * np.eye(len(columns))
        ends = yield from together([measure(off + side * one) for one in step for side in (1, -1)])
        slope = (np.array(ends[::2]) - np.array(ends[1::2])) / (2 * STEP)
        weight = whole.effective / mean_squares(residual[None], posed.floor)[0]
        tried = off.copy()
        for group in groups:
            own = group[chosen]
            tried[group] += np.clip(
                _step(residual[own], slope[:, own], weight[own], off[group][0]), -1.0, 1.0
            )
        made = yield from measure(tried)
        price = _cost(made, whole)
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


def shifted(robot: Robot, logged: Windows, free: Windows) -> dict[str, float]:
    """The most that positions of an episode in `free` are away from the logged ones, by channel, in its unit."""
    apart = np.nanmax(np.abs(free.run.initial - logged.run.initial), axis=0, initial=0.0)
    return {name: float(most) for name, most in zip(robot.channels, apart, strict=True) if most > 0}


def _moved(raw: Windows, columns: np.ndarray, by: np.ndarray) -> Windows:
    """Windows with the channels `columns` moved: by (W, K), in their unit."""
    measured, initial = raw.measured.copy(), raw.run.initial.copy()
    measured[..., columns] += by[:, None]
    initial[:, columns] += by
    return replace(raw, measured=measured, run=replace(raw.run, initial=initial))


def _residual(model: Model, windows: Windows, point: Point, sample: Sample) -> Search[np.ndarray]:
    """(W, T, C) residual of `point` in other windows than the sample's, with the same numbers."""
    there = replace(sample, data=replace(sample.data, windows=windows))
    return (yield from model.residuals([point], there))[0]


def _cost(residual: np.ndarray, sample: Sample) -> np.ndarray:
    """(W,) of a residual (W, T, C) in each window [nats]."""
    squares = mean_squares(residual[None], sample.data.floor)[0]
    return 0.5 * np.nansum(sample.effective * np.log(squares), axis=1)


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
