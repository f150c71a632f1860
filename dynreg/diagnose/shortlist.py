"""Long lists of terms: one probe of each, and full refits only for the few that the probes leave.

A robot with many joints has hundreds of terms. Every one is simulated once for each of its sizes, and what the
nominal parameters and the sizes could do is worked out to first order from these probes. The most promising are
tried at several sizes; their number is halved after every step of their refits, in which derivatives by the nominal
parameters are those of the calibrated model.
"""

from collections.abc import Iterable
from itertools import zip_longest

import numpy as np

from dynreg.diagnose.effort import FULL, Effort
from dynreg.diagnose.fit import bounds, fit, objective, sensitivities
from dynreg.diagnose.hypothesis import SMALLEST, effect_bounds
from dynreg.diagnose.problem import Point, Problem, mean_squares
from dynreg.sim.effects import Term

PROBED = 16  # terms that are tried at several sizes,
SIZES = (0.5, 1.0, 2.0)  # these times what the probe says is best,
HALVED = (1, 1)  # and refitted in rounds of so many iterations, half as many after each
REFINED = 0.2  # of the medium size, for probes of what acts on joints already: as much friction again, and they stick
PULL = 3.0  # largest first change of a nominal coordinate
# From the nameplate of a floating base none of many nominal parameters is fitted yet, and one shared step leaves all
# terms about as bad: so many of the best go on, by so many iterations. A cause that nominal parameters can make up for
# is found from there, one in a single joint from the calibrated model.
GO_ON, FURTHER = 5, 3
CLEAR = 300.0  # nats ahead of the calibrated model, from which what starts at the nameplate needs nothing beside it
GAINED = 20.0  # nats, by the finer time step, that a term from the calibrated model must have gained


def shortlisted(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    effective: np.ndarray,
    hopeless: float = np.inf,
    effort: Effort = FULL,
) -> list[Point]:
    """`base` with one of `terms`, refitted: the best of them, one point for each term, best first.

    Where rollouts are rough, nominal parameters that made up for a cause are hard to walk back: half of the terms that
    are refitted start from the nameplate. Their refit is only begun: the finer time step ends it elsewhere. Those of a
    floating base come in turn from the nameplate and from `base`, for where they are on their way says little.
    hopeless : where rollouts are smooth, a term that is so many nats behind the best is not fitted to the end.
    """
    nameplate = Point(base.hypothesis, np.zeros(len(base.nominal)), base.effect)
    start = lambda point, further=0: roughly_from(  # noqa: E731
        problem, point, terms, fit_on, effective, further, effort.behind
    )
    if problem.stands:
        ahead = start(nameplate, FURTHER)
        without = objective(problem, [base], problem.fine.residuals([base], fit_on), effective)[0]
        return in_turn(ahead, [] if clear(ahead, without) else start(base), without)
    if problem.rough:
        return best_of_each([*start(base), *start(nameplate)])
    return best_of_each(_from(problem, base, terms, fit_on, effective, effort.iterations, hopeless))


def clear(ahead: list[tuple[float, Point]], without: float) -> bool:
    """Whether what started at the nameplate is so far ahead of the calibrated model that it needs nothing beside it."""
    return min(cost for cost, _ in ahead) < without - CLEAR


def best_of_each(found: Iterable[tuple[float, Point]]) -> list[Point]:
    """The best point of each term, best first."""
    best: dict[str, Point] = {}
    for _, point in sorted(found, key=lambda d: d[0]):
        best.setdefault(point.hypothesis.key, point)
    return list(best.values())


def in_turn(ahead: list[tuple[float, Point]], near: list[tuple[float, Point]], without: float) -> list[Point]:
    """The best from the nameplate and from the calibrated model in turn, each term once.

    near : what started at the calibrated model; what gains too little on it (`without` a term) is left out.
    """
    gained = [(cost, point) for cost, point in near if cost < without - GAINED]
    out: dict[str, Point] = {}
    for row in zip_longest(best_of_each(ahead), best_of_each(gained)):
        for point in row:
            if point is not None:
                out.setdefault(point.hypothesis.key, point)
    return list(out.values())


def _from(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    effective: np.ndarray,
    iterations: int,
    hopeless: float,
) -> list[tuple[float, Point]]:
    """Objective and refitted point of each of the most promising terms."""
    points, slopes = _started(problem, base, terms, fit_on, effective)
    done: list[tuple[float, Point]] = []
    for number in HALVED:
        points, cost = fit(problem, points, fit_on, effective, iterations=number, leading=slopes)
        order = np.argsort(cost, kind="stable")
        half = (len(order) + 1) // 2
        done += [(float(cost[i]), points[i]) for i in order[half:]]
        points = [points[i] for i in order[:half]]
    # the best have moved away from the calibrated model: derivatives and the time step's part anew, where they are
    if problem.coarse:
        problem.refine(points, np.arange(len(problem.windows)))
    slopes = sensitivities(problem, points[:1], fit_on)[1][0][: len(base.z)]
    last = {"iterations": iterations, "leading": slopes, "hopeless": hopeless}
    points, cost = fit(problem, points, fit_on, effective, **last)
    return done + [(float(c), p) for c, p in zip(cost, points, strict=True)]


def roughly_from(
    problem: Problem,
    start: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    effective: np.ndarray,
    further: int = 0,
    behind: float = FULL.behind,
) -> list[tuple[float, Point]]:
    """Objective, by the finer time step, and point of each of the most promising terms after one step of its refit.

    What the time step does to the start flatters all that stays near it: only the finer one judges.
    further : iterations by which the best terms go on, with derivatives of their own. behind : nats behind the best
    from which a term is left out.
    """
    points, slopes = _started(problem, start, terms, fit_on, effective)
    points, cost = fit(problem, points[: PROBED // 2], fit_on, effective, iterations=1, leading=slopes)
    if further:
        points = [points[i] for i in np.argsort(cost, kind="stable")]
        ahead, _ = fit(problem, points[:GO_ON], fit_on, effective, iterations=further)
        points = [*ahead, *points[GO_ON:]]
    cost = objective(problem, points, problem.fine.residuals(points, fit_on), effective)
    behind = np.inf if further else behind  # those that went on are ahead of the others by that alone
    return [(float(c), p) for c, p in zip(cost, points, strict=True) if c <= cost.min() + behind]


def _started(
    problem: Problem, base: Point, terms: list[Term], fit_on: np.ndarray, effective: np.ndarray
) -> tuple[list[Point], np.ndarray]:
    """The most promising terms at the best size that was tried, best first; derivatives (D, W, T, C) at `base`."""
    residual, (slopes,) = sensitivities(problem, [base], fit_on)
    starts = _probed(problem, base, terms, fit_on, effective, residual[0], slopes)[:PROBED]
    points = [p for own in starts for p in own]
    cost = objective(problem, points, problem.residuals(points, fit_on), effective)
    return best_of_each(zip(cost, points, strict=True)), slopes


def _probed(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    effective: np.ndarray,
    residual: np.ndarray,
    slopes: np.ndarray,
) -> list[list[Point]]:
    """Of each term its points at several sizes, by first order; the most promising term first.

    residual : (W, T, C) of `base`. slopes : (D, W, T, C) its derivatives.
    """
    probes = [_probes(base, term) for term in terms]
    tried = [p for own in probes for p in own]
    made = problem.residuals(tried, fit_on)
    linear = _Linear(problem, base, residual, slopes, effective)
    found, at = {}, 0
    for own in probes:
        found[own[0].hypothesis.key] = linear.starts(own, made[at : at + len(own)] - residual)
        at += len(own)
    order = sorted(found, key=lambda key: found[key][0])
    if not problem.rough:
        return [found[key][1] for key in order]
    # jumps bend what first order takes for straight: what the probes themselves reach, of either sign, counts as much
    cost = objective(problem, tried, made, effective)
    turned = [m for p in tried for m in mirrored(p)]
    if turned:
        cost = np.append(cost, objective(problem, turned, problem.residuals(turned, fit_on), effective))
    reached = {p.hypothesis.key: p for p in best_of_each(zip(cost, [*tried, *turned], strict=True))}
    either = dict.fromkeys(key for pair in zip(order, reached, strict=True) for key in pair)
    return [[*found[key][1], reached[key]] for key in either]


def mirrored(point: Point) -> list[Point]:
    """The probe with the other sign, where its size has one."""
    term = point.hypothesis.terms[-1]
    signed = np.array([p.signed for p in term.effect.parameters])
    effect = point.effect.copy()
    own = effect[len(effect) - len(signed) :]
    if not own[signed].any():
        return []
    own[signed] *= -1.0
    low, high = effect_bounds(point.hypothesis).T
    return [Point(point.hypothesis, point.nominal, np.clip(effect, low, high))]


def _probes(base: Point, term: Term) -> list[Point]:
    """`base` with the term at medium size, once for each of its sizes alone; shapes at their typical value.

    What acts on some of these joints already is only refined: it is probed at a smaller size.
    """
    hypothesis = base.hypothesis.with_term(term)
    parameters = term.effect.parameters
    same = [one.joints for one in base.hypothesis.terms if one.effect.id == term.effect.id]
    acting = any(not term.joints or not other or set(term.joints) & set(other) for other in same)
    size = REFINED if acting else 1.0
    low, high = effect_bounds(hypothesis)[-len(parameters) :].T
    nothing = np.array([0.0 if p.shape or p.signed else SMALLEST for p in parameters])
    out = []
    for i, p in enumerate(parameters):
        if p.shape:
            continue
        z = nothing.copy()
        z[i] = size
        out.append(Point(hypothesis, base.nominal, np.concatenate([base.effect, np.clip(z, low, high)])))
    return out


class _Linear:
    """The objective around a point, its residual taken to be linear in all coordinates."""

    def __init__(
        self, problem: Problem, base: Point, residual: np.ndarray, slopes: np.ndarray, effective: np.ndarray
    ):
        self.problem, self.base, self.residual, self.effective = problem, base, residual, effective
        squares = mean_squares(residual[None], problem.floor)[0]
        weight = np.nan_to_num(effective / squares) / max(residual.shape[1], 1)
        self.root = np.sqrt(np.broadcast_to(weight[:, None], residual.shape)).reshape(-1)
        self.flat = np.nan_to_num(slopes).reshape(len(slopes), -1) * self.root
        self.rest = np.nan_to_num(residual).reshape(-1) * self.root
        self.prior = base.prior
        self.slopes = slopes

    def starts(self, probes: list[Point], changes: np.ndarray) -> tuple[float, list[Point]]:
        """Objective at the best size, and points at `SIZES` times it. changes : (K, W, T, C) of the probes."""
        many = len(self.base.z)
        sized = [i for i, p in enumerate(probes[0].hypothesis.terms[-1].effect.parameters) if not p.shape]
        width = np.array([p.effect[len(self.base.effect) + i] for p, i in zip(probes, sized, strict=True)])
        scaled = np.nan_to_num(changes) / width[:, None, None, None]
        j = np.concatenate([self.flat, scaled.reshape(len(scaled), -1) * self.root])
        prior = np.concatenate([self.prior, np.zeros(len(sized))])
        curvature = j @ j.T + np.diag(prior + 1e-9)
        start = np.concatenate([self.base.z, np.zeros(len(sized))])
        best = np.linalg.lstsq(curvature, -j @ self.rest - prior * start, rcond=1e-12)[0]
        limits, own = bounds(self.problem, probes[0]), [many + i for i in sized]
        out = []
        for share in SIZES:  # the other coordinates follow the size
            size = np.clip(share * best[many:], *limits[own].T)
            pull = -j[:many] @ (self.rest + size @ j[many:]) - self.prior * self.base.z
            move = np.linalg.lstsq(curvature[:many, :many], pull, rcond=1e-12)[0]
            move = np.clip(move, -PULL, PULL)
            z = probes[0].z.copy()
            z[:many] += move
            z[own] = size
            point = probes[0].moved(np.clip(z, *limits.T))
            after = self.residual + np.tensordot(size, scaled, 1) + np.tensordot(move, self.slopes, 1)
            out.append((float(objective(self.problem, [point], after[None], self.effective)[0]), point))
        return min(c for c, _ in out), [p for _, p in out]
