"""The last steps to a better simulator, with slopes that are simulated: Gauss-Newton on the residuals.

The rounds of `synthesise.refine` end near the best parameters, not at them: their slopes are regressed on replays that
lie far apart. Here each free parameter is moved a little to both sides of the best replay. The differences are the
slopes there, and what both sides disagree in is how far these are wrong (curvature; in contacts, chaos).
"""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.neighbours.synthesise import (
    Local,
    Replays,
    Residuals,
    features,
    normal_equations,
    replays_of,
    taken,
    weights,
)
from dynreg.replay.start_error import StartErrors, StartSlopes

# Of each range, to both sides: in the first round, and never less or more in a later one. With 0.02 at most, an arm of
# seven joints erred by 1 % more on held-out data, and one joint got a dry friction that it does not have (0.018 N m,
# interval 0.006 to 0.029); a wheeled base got the same answer.
STEP, LEAST, FAR = 0.02, 0.001, 0.1
# Six rounds left an arm of seven joints on its way (error 0.0028, its best 0.0027); nine reached it.
ROUNDS = 10
# Of the steps that a round replays, from bold to careful, in units of each parameter's own curvature (Marquardt 1963):
# in units of their mean, the stiffest parameter holds back all others.
DAMPING = (1e-4, 1e-2, 0.1, 1.0)
REWEIGHTED = 8  # times that the weights of least absolute residuals follow a step
# Share of a window's slopes, squared, in which both sides disagree and above which they are chance.
CHANCE = 0.1
FEATURES = 20_000  # residual samples kept: the slopes of some fifty parameters have to be told apart
GAIN = 2e-4  # share of the error that a round must save for another to follow


def cost(free: int) -> int:
    """Replays of one round with so many free parameters."""
    return 2 * free + len(DAMPING)


@dataclass(frozen=True, eq=False)
class Made:
    """A simulator that was made: the best of some replays, judged without errors of their start states.

    residual : (W', T, S') its own, with the measured start states. local : the linear model about it; start : the
    start errors that the last round took out. None without a round. initial : (W', S) start states of the replays,
    None for the measured ones.
    """

    replays: Replays
    residual: np.ndarray
    local: Local | None = None
    start: StartErrors | None = None
    initial: np.ndarray | None = None

    @property
    def best(self) -> int:
        """Which of the replays it is."""
        return int(self.replays.score.argmin())


def sharpen(
    begun: Replays, residual: np.ndarray, replay: Residuals, slopes: StartSlopes, budget: int
) -> Made:
    """The best after rounds that begin at the best of some replays, with residuals (W', T, S').

    replay : residuals (n, W', T, S') of unit parameters (n, P). Start errors are told anew in each round, as residuals
    nearer the robot's tell them better. It takes whole rounds within the budget; one that finds nothing better is the
    last. The replays of that one are in what is made.
    """
    free = np.flatnonzero(begun.free)
    made = Made(begun, residual)
    reach = np.full(len(free), STEP)
    for _ in range(min(ROUNDS, budget // cost(len(free)))):
        made = _round(made, replay, slopes, reach)
        if made.replays.score[made.best] > (1.0 - GAIN) * made.replays.score[0]:
            break
        reach = _reach(made.local)
    return made


def _round(before: Made, replay: Residuals, slopes: StartSlopes, reach: np.ndarray) -> Made:
    """What is made of both sides of the best and of the steps that these tell."""
    begun, free = before.replays, np.flatnonzero(before.replays.free)
    start, raw = slopes.errors(before.residual), before.residual[None]
    unit = begun.unit[[before.best]]
    replays = replays_of(begun.space, begun.free, begun.to_fit, unit, start.removed(raw))
    sides = _sides(unit[0], free, reach)
    raw = np.concatenate([raw, replay(sides)])
    replays = replays.grown(sides, start.removed(raw[1:]))
    steps = _steps(_measured(replays), free)
    raw = np.concatenate([raw, replay(steps)])
    replays = replays.grown(steps, start.removed(raw[-len(steps) :]))
    best = int(replays.score.argmin())
    return Made(replays, raw[best], _moved(replays, _measured(replays)), start)


def promised(local: Local, free: np.ndarray) -> float:
    """The error that the linear model promises for a bold step within the ranges, over the one about which it stands.

    About 1 where the search has ended; less where it gave up on a way that bends. free : (P,) which parameters are.
    """
    step = _steps(local, np.flatnonzero(free))[0] - local.centre
    left = local.residual + local.jacobian @ step[free]
    return min(float(np.abs(left).mean() / np.abs(local.residual).mean()), 1.0)


def _reach(local: Local) -> np.ndarray:
    """(P_free,) how far each parameter moves to change the residuals by as much as they are: slopes hold so far."""
    change = np.sqrt(local.weight @ local.jacobian**2)
    return np.clip(np.sqrt(local.weight @ local.residual**2) / np.maximum(change, 1e-300), LEAST, FAR)


def _sides(centre: np.ndarray, free: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(2 P_free, P) unit parameters with each free one moved by its reach (P_free,) down and up, inside its range."""
    sides = np.repeat(centre[None], 2 * len(free), axis=0)
    rows = np.arange(len(free))
    sides[2 * rows, free] = np.maximum(centre[free] - reach, 0.0)
    sides[2 * rows + 1, free] = np.minimum(centre[free] + reach, 1.0)
    return sides


def _measured(replays: Replays) -> Local:
    """The linear model about the first replay, of the replays of its sides, which follow it."""
    free = np.flatnonzero(replays.free)
    index = features(replays, FEATURES)
    flat = taken(replays.residuals, index)
    centre, residual = replays.unit[0], flat[0]
    below, above = (slice(1 + side, 1 + 2 * len(free), 2) for side in (0, 1))
    rows = np.arange(len(free))
    down = centre[free] - replays.unit[below][rows, free]
    up = replays.unit[above][rows, free] - centre[free]
    jacobian = ((flat[above] - flat[below]) / (up + down)[:, None]).T
    weight = weights(residual)
    # a jump on one side, as where a joint sticks or slides, is in the mean slope by just as much as the sides disagree
    both = np.minimum(up, down) > 0
    slopes = [(flat[above] - residual) / np.where(both, up, 1.0)[:, None]]
    slopes += [(residual - flat[below]) / np.where(both, down, 1.0)[:, None]]
    apart = np.where(both[:, None], 0.5 * (slopes[0] - slopes[1]), 0.0).T
    clear = _clear(jacobian, apart, weight, index // np.prod(replays.residuals.shape[2:]))
    doubt = np.diag((weight * clear) @ apart**2)
    return Local(centre, jacobian, residual, weight, doubt, index, clear)


def _clear(jacobian: np.ndarray, apart: np.ndarray, weight: np.ndarray, window: np.ndarray) -> np.ndarray:
    """(F,) whether a feature's window (F,) has slopes (F, P_free) in which both sides agree, all parameters together.

    Where a foot slips a little earlier, what follows is another motion: such a window tells nothing.
    """
    windows, number = np.unique(window, return_inverse=True)
    agreed, disagreed = np.zeros((2, len(windows), jacobian.shape[1]))
    np.add.at(agreed, number, weight[:, None] * jacobian**2)
    np.add.at(disagreed, number, weight[:, None] * apart**2)
    whole = np.maximum(agreed.sum(axis=0), 1e-300)
    return ((disagreed / whole).sum(axis=1) <= CHANCE * (agreed / whole).sum(axis=1))[number]


def _steps(local: Local, free: np.ndarray) -> np.ndarray:
    """(D, P) unit parameters that the linear model calls best within their ranges, one for each damping.

    Least absolute residuals, by reweighted least squares with bounds.
    """
    local = replace(local, weight=local.weight * local.clear) if local.clear.any() else local
    hessian, _ = normal_equations(local)
    size = np.diag(hessian)
    size = np.diag(size + 1e-9 * size.mean() + 1e-12)
    room = (-local.centre[free], 1.0 - local.centre[free])
    steps = np.repeat(local.centre[None], len(DAMPING), axis=0)
    for step, damping in zip(steps, DAMPING, strict=True):
        model = local
        for _ in range(REWEIGHTED):
            hessian, slope = normal_equations(model)
            move = _bounded(hessian + damping * size, slope, room)
            model = replace(
                local, weight=weights(local.residual + local.jacobian @ move) * (local.weight > 0)
            )
        step[free] = local.centre[free] + move
    return np.clip(steps, 0.0, 1.0)


def _bounded(hessian: np.ndarray, slope: np.ndarray, room: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(P,) the least of a quadratic, m . slope + m . hessian m / 2, within (P,) bounds on both sides that hold 0."""
    from scipy.optimize import lsq_linear

    factor = np.linalg.cholesky(hessian)
    low, high = (np.minimum(room[0], -1e-12), np.maximum(room[1], 1e-12))  # none of them is closed
    return lsq_linear(factor.T, -np.linalg.solve(factor, slope), (low, high), method="bvls").x


def _moved(replays: Replays, local: Local) -> Local:
    """The model about the best replay: slopes of the last round, residuals of this replay."""
    best = int(np.argmin(replays.score))
    (residual,) = taken(replays.residuals[[best]], local.index)
    return replace(local, centre=replays.unit[best], residual=residual, weight=weights(residual))
