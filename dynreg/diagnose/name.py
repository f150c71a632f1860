"""Name the cause: screen, refit, score, select, and stop when nothing passes."""

from dataclasses import dataclass, field

import numpy as np

from dynreg.diagnose.fit import fit, information, known_near, objective, polish, sensitivities, uneven
from dynreg.diagnose.hypothesis import Hypothesis, effect_bounds, worth_naming
from dynreg.diagnose.problem import Point, Problem, log_likelihood, mean_squares
from dynreg.diagnose.shortlist import MANY, shortlisted
from dynreg.rng import stream
from dynreg.sim.effects import Term

SCREEN = (0.3, 1.0, 2.5)  # sizes that the screening tries, in medium sizes
FAR = 10.0  # standard deviations that a start's nominal coordinates may be moved
KEPT = 2  # starts of each hypothesis that are refitted by one iteration,
FINALISTS = 16  # and to the end: the best of each hypothesis, and others where there is room
FINE = 8  # of a long list, where rollouts are rough: those that are refitted with a finer time step,
SHARED = 1  # by so many iterations with shared derivatives,
FINISHED = 3  # and those that are polished with their own,
POLISHED = 3  # by so many
# Of a floating base on its feet: terms that take one step by the finer time step on the windows to fit, those of them
# that take one on all windows, and those that take three more; iterations of the model without a term, and of it from
# where the best of them ended. The numbers are what two minutes allow.
STANDING = (6, 4, 3)
STANDING_START, STANDING_RIVAL = 4, 2
AWAY = 300.0  # nats behind the best, from which a term does not take these three
CHAOS = 5.0  # nats that an iteration must gain for another one: less is a foot that slips a moment earlier
DRAWS = 4  # starts of the calibration besides the nameplate
HOPELESS = 60.0  # nats behind the best, from which a hypothesis is not fitted to the end
ROUNDS = 2  # of naming, where the first found a better model without the term on its way:
BETTER = 2.0  # nats better
PER_PARAMETER = 2.0  # nats that a parameter of an effect must pay for itself
NEAR = 0.05  # share of the best score, but at least
FEW = 3.0  # nats, within which fewer parameters are the better explanation;
BEYOND = 5.0  # nats that fit may gain beyond twice what select gains: more is fitted noise
NATS = 15.0  # nats (or that share) within which hypotheses count as equal


@dataclass(frozen=True)
class Scored:
    """A fitted hypothesis: its point, and by how many nats it beats the model without its last term."""

    point: Point
    nats: float

    @property
    def key(self) -> str:
        return self.point.hypothesis.key


@dataclass
class Naming:
    """One round: the calibrated model that it started from, the ranking, and what was chosen.

    improved : whether the start turned out better than the calibration that the round began with.
    """

    start: Scored
    ranking: list[Scored]
    chosen: Scored | None = None
    equivalent: list[Scored] = field(default_factory=list)
    improved: bool = False


def calibrate(
    problem: Problem, fit_on: np.ndarray, *, iterations: int = 8, draws: int = DRAWS, seed: int = 0
) -> tuple[Point, np.ndarray]:
    """The plain model at its maximum a posteriori, and the independent samples (W, C) that its residual has.

    Starts at the nameplate and at `draws` from its tolerances: dry friction makes local optima.
    """
    many = len(problem.coordinates)
    apart = stream(seed, "calibrate").standard_normal((draws, many))
    points = [Point(Hypothesis(), z, np.zeros(0)) for z in (np.zeros(many), *apart)]
    problem.rough = problem.rough or (problem.coarse and uneven(problem, points[0], fit_on))
    effective = np.full((len(fit_on) * problem.segments, len(problem.use)), 20.0 / problem.segments)
    if problem.rough:  # what the time step does to contacts leads the fit astray from its start
        problem.refine(points[:1], np.arange(len(problem.windows)))
    points, cost = fit(problem, points, fit_on, effective, iterations=3)
    for rounds, kept in ((3, 2), (iterations, 1)) if draws else ((iterations, 1),):
        points = [points[i] for i in np.argsort(cost, kind="stable")[:kept]]
        effective = problem.effective(problem.residuals(points[:1], fit_on)[0])
        points, cost = fit(problem, points, fit_on, effective, iterations=rounds, tolerance=0.05)
        if kept == 1 and problem.coarse:
            problem.refine(points, np.arange(len(problem.windows)))
            points, cost = fit(problem, points, fit_on, effective, iterations=rounds, tolerance=0.05)
    return points[0], problem.effective(problem.residuals(points[:1], fit_on)[0])


def name_one(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    effective: np.ndarray,
    *,
    iterations: int = 5,
) -> Naming:
    """The term that, added to `base`, explains most of what `base` leaves: one round of naming.

    effective : (W, C) independent samples of the fit windows.
    """
    many = len(terms) > MANY
    for _ in range(ROUNDS):
        naming = _one_round(problem, base, terms, fit_on, select_on, effective, iterations, many)
        base = naming.start.point
        if not naming.improved or not naming.ranking:
            break
        if many:  # the best of a long list stay the best
            terms = [scored.point.hypothesis.terms[-1] for scored in naming.ranking]
    return naming


def _one_round(
    problem: Problem,
    base: Point,
    terms: list[Term],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    effective: np.ndarray,
    iterations: int,
    many: bool,
) -> Naming:
    if many:
        if problem.rough and base.hypothesis.keys not in problem.corrections:
            problem.refine([base], np.arange(len(problem.windows)))
        fitted = shortlisted(problem, base, terms, fit_on, effective, iterations, HOPELESS)
    else:
        starts, slopes = screen(problem, base, terms, fit_on, effective)
        rough, cost = fit(problem, starts, fit_on, effective, iterations=1, leading=slopes)
        best = _best_of_each(rough, cost)[:FINALISTS]
        fitted, _ = fit(problem, best, fit_on, effective, iterations=iterations, hopeless=HOPELESS)
    if many and problem.stands:
        start, fitted = _standing(problem, base, fitted, fit_on, select_on)
        return select(problem.fine, start, fitted, fit_on, select_on, together=True)
    # the model without the term gets the same chance: it starts where the best of the others ended, too
    rivals = fitted[: 1 if many else 3]
    others = [base, *(Point(base.hypothesis, p.nominal, p.effect[: len(base.effect)]) for p in rivals)]
    again, price = fit(problem, others, fit_on, effective, iterations=2 if many else iterations)
    start = again[int(price.argmin())]
    improved = float(price[0] - price.min()) > BETTER
    if many and problem.rough:
        improved = False  # all are refitted from where they are by now
        start, fitted = _finished(problem, start, fitted[:FINE], fit_on, select_on)
        naming = select(problem.fine, start, fitted, fit_on, select_on)
    else:
        naming = select(problem, start, fitted, fit_on, select_on)
    naming.improved = improved
    return naming


def _finished(
    problem: Problem, start: Point, fitted: list[Point], fit_on: np.ndarray, select_on: np.ndarray
) -> tuple[Point, list[Point]]:
    """The model without the term and those with it, refitted with finer time steps, best first.

    First all share the derivatives by the nominal parameters of the best, then the best are polished with their own.
    The model without the term starts where one of them ended, too, and is chosen as they are: by all windows.
    """
    fine = problem.fine
    known = known_near(fine, fitted[0], len(start.nominal), fit_on)
    fitted, cost = fit(fine, fitted, fit_on, iterations=SHARED, **known)
    fitted = [fitted[i] for i in np.argsort(cost, kind="stable")[:FINISHED]]
    (start, *fitted), residuals = polish(
        problem, [start, *fitted], fit_on, iterations=POLISHED, hopeless=HOPELESS
    )
    cost = objective(problem, fitted, residuals[1:], problem.effective(residuals[1]))
    fitted = [fitted[i] for i in np.argsort(cost, kind="stable")]
    windows = np.concatenate([fit_on, select_on])
    rivals = [Point(start.hypothesis, p.nominal, p.effect[: len(start.effect)]) for p in fitted]
    rival = _best(fine, rivals, windows)
    return _best(fine, [start, *polish(problem, [rival], fit_on, iterations=POLISHED)[0]], windows), fitted


def _standing(
    problem: Problem, start: Point, fitted: list[Point], fit_on: np.ndarray, select_on: np.ndarray
) -> tuple[Point, list[Point]]:
    """As `_finished`, of a floating base on its feet: fitted on all windows, all steps tried with the finer time step.

    On half of the windows wrong causes fit what disturbs them better than the true one does, and the usual time step's
    derivatives stop far from the optimum, that of the model without the term above all: what it lacks any cause gains.
    """
    fine, windows = problem.fine, np.concatenate([fit_on, select_on])
    effective = problem.effective(fine.residuals([start], windows)[0])
    first = effective[: len(fit_on) * problem.segments]

    def best(points: list[Point], many: int) -> list[Point]:
        cost = objective(problem, points, fine.residuals(points, windows), effective)
        return [points[i] for i in np.argsort(cost, kind="stable")[:many]]

    fitted, _ = fit(fine, fitted[: STANDING[0]], fit_on, first, iterations=1)
    fitted, cost = fit(fine, best(fitted, STANDING[1]), windows, effective, iterations=1)
    fitted = [fitted[i] for i in np.argsort(cost, kind="stable")]
    close = min(int((cost <= cost.min() + AWAY).sum()), STANDING[2])
    ahead, _ = fit(fine, fitted[:close], windows, effective, iterations=3, tolerance=CHAOS, hopeless=HOPELESS)
    fitted = best([*ahead, *fitted[close:]], len(fitted))
    (start,), _ = fit(fine, [start], windows, effective, iterations=STANDING_START, tolerance=CHAOS)
    rival = Point(start.hypothesis, fitted[0].nominal, fitted[0].effect[: len(start.effect)])
    (rival,), _ = fit(fine, [rival], windows, effective, iterations=STANDING_RIVAL, tolerance=CHAOS)
    return best([start, rival], 1)[0], fitted


def _best(problem: Problem, points: list[Point], windows: np.ndarray) -> Point:
    """The point with the lowest objective on all these windows."""
    residuals = problem.residuals(points, windows)
    return points[int(objective(problem, points, residuals, problem.effective(residuals[0])).argmin())]


def screen(
    problem: Problem, base: Point, terms: list[Term], fit_on: np.ndarray, effective: np.ndarray
) -> tuple[list[Point], np.ndarray]:
    """For every term the most promising starts: sizes and signs tried, nominal coordinates moved along to first order.

    Returns them with the derivatives (D, W, T, C) at `base`. A term's change of the rollouts counts after what the
    nominal parameters can do as well is taken off.
    """
    residual, slopes = sensitivities(problem, [base], fit_on)
    curvature, _ = information(problem, base, residual[0], slopes[0], effective)
    tried: list[Point] = []
    for term in terms:
        hypothesis = base.hypothesis.with_term(term)
        for z in _starts(term):
            tried.append(Point(hypothesis, base.nominal, np.concatenate([base.effect, z])))
    made = problem.residuals(tried, fit_on)
    squares = mean_squares(residual, problem.floor)[0]
    weight = np.nan_to_num(effective / squares) / max(residual.shape[2], 1)
    inverse = np.linalg.pinv(curvature)  # coordinates at a bound may do nothing
    flat = np.nan_to_num(slopes[0]).reshape(len(slopes[0]), -1)
    weights = np.broadcast_to(weight[:, None], residual.shape[1:]).reshape(-1)
    gains, moves = np.empty(len(tried)), []
    for i in range(len(tried)):
        new = np.nan_to_num(made[i]).reshape(-1)
        pull = -(flat * weights) @ new - base.prior * base.z
        move = inverse @ pull
        after = new + flat.T @ move
        # the size of the residual is unknown: gains count by the logarithm, as in the objective
        price = 0.5 * base.prior @ (base.z + move) ** 2
        gains[i] = -_log_square(problem, after, residual.shape[1:], effective) - price
        moves.append(move)
    return _best_starts(problem, base, terms, tried, gains, moves), slopes[0]


def select(
    problem: Problem,
    base: Point,
    fitted: list[Point],
    fit_on: np.ndarray,
    select_on: np.ndarray,
    *,
    together: bool = False,
) -> Naming:
    """Score on all windows, drop what is below half its weak size, prefer fewer parameters among equals.

    What a term gains where it was fitted counts only as far as the windows to select by confirm it.
    together : all were fitted on all windows, and nothing confirms anything: the threshold alone tells chance.
    """
    windows = np.concatenate([fit_on, select_on])
    everything = problem.residuals([base, *fitted], windows)
    squares = mean_squares(everything, problem.floor)
    if together:
        likelihood = _by_either(problem, everything, squares)
    else:
        rough = np.array([np.nansum(np.log(s)) for s in squares])
        effective = problem.effective(everything[int(rough.argmin())])
        many = len(fit_on) * problem.segments
        gained = [log_likelihood(squares[:, w], effective[w]) for w in (slice(None, many), slice(many, None))]
        on_fit, on_select = (g - g[0] for g in gained)
        likelihood = np.minimum(on_fit, 2.0 * np.maximum(on_select, 0.0) + BEYOND) + on_select
    start = Scored(base, 0.0)
    best: dict[str, Scored] = {}
    for i, point in enumerate(fitted, start=1):
        more = len(point.effect) - len(base.effect)
        nats = likelihood[i] - PER_PARAMETER * more - (point.penalty - base.penalty)
        if not worth_naming(point.hypothesis, point.effect):
            continue
        scored = Scored(point, float(nats))
        if scored.key not in best or best[scored.key].nats < scored.nats:
            best[scored.key] = scored
    ranking = sorted(best.values(), key=lambda s: -s.nats)
    naming = Naming(start, ranking)
    if ranking and ranking[0].nats > 0:
        top = ranking[0].nats
        near = [s for s in ranking if s.nats >= top - max(NEAR * top, FEW)]
        naming.chosen = min(near, key=lambda s: (len(s.point.effect), -s.nats))
        within = max(NEAR * top, NATS)
        naming.equivalent = [s for s in ranking if s.nats >= top - within and s is not naming.chosen]
    return naming


def _by_either(problem: Problem, residuals: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """(n,) what each gains on the first, by the independent samples of its own residual or of the first's.

    The less of both: where every window slips on its own, which of them count for more makes up gains of 100 nats.
    """
    samples = [problem.effective(r) for r in residuals]
    gains = []
    for square, own in zip(squares, samples, strict=True):
        pair = np.stack([squares[0], square])
        gains.append(min(float(np.diff(log_likelihood(pair, e))[0]) for e in (samples[0], own)))
    return np.array(gains)


def _best_of_each(points: list[Point], cost: np.ndarray) -> list[Point]:
    """The best start of each hypothesis, best first; then the others."""
    out: dict[str, Point] = {}
    for i in np.argsort(cost, kind="stable"):
        out.setdefault(points[i].hypothesis.key, points[i])
    first = {id(point) for point in out.values()}
    others = [points[i] for i in np.argsort(cost, kind="stable") if id(points[i]) not in first]
    return [*out.values(), *others]


def _starts(term: Term) -> list[np.ndarray]:
    """Effect coordinates to try: some sizes, both signs where it has one; shapes at their typical value."""
    parameters = term.effect.parameters
    low, high = effect_bounds(Hypothesis((term,))).T
    sized = [i for i, p in enumerate(parameters) if not p.shape]
    out = []
    for size in SCREEN:
        signs = [[1.0]]
        if parameters[0].signed:
            # two signed parameters (a phase): four quadrants
            both = len(sized) > 1 and parameters[sized[1]].signed
            signs = [[a, b] for a in (1.0, -1.0) for b in (1.0, -1.0)] if both else [[1.0], [-1.0]]
        for sign in signs:
            z = np.zeros(len(parameters))
            for k, i in enumerate(sized):
                z[i] = size * (sign[k] if k < len(sign) else 1.0)
            out.append(np.clip(z, low, high))
    return out


def _best_starts(
    problem: Problem,
    base: Point,
    terms: list[Term],
    tried: list[Point],
    gains: np.ndarray,
    moves: list[np.ndarray],
) -> list[Point]:
    from dynreg.diagnose.fit import bounds

    out, at = [], 0
    for term in terms:
        many = len(_starts(term))
        order = np.argsort(-gains[at : at + many])[:KEPT] + at
        for i in order:
            limits = bounds(problem, tried[i])
            z = tried[i].z.copy()
            z[: len(moves[i])] += np.clip(moves[i], -FAR, FAR)
            out.append(tried[i].moved(np.clip(z, limits[:, 0], limits[:, 1])))
        at += many
    return out


def _log_square(problem: Problem, flat: np.ndarray, shape: tuple, effective: np.ndarray) -> float:
    squares = mean_squares(flat.reshape(1, *shape), problem.floor)
    return -float(log_likelihood(squares, effective)[0])
