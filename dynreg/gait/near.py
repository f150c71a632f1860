"""The search near a gait that walked on the robot, in simulators of several logs."""

from typing import Unpack

import numpy as np

from dynreg.gait.accept import ACCEPT
from dynreg.gait.seek import Finals, Followed, SearchSettings, Sought, answer, driven
from dynreg.gait.tasks import fell, fitness
from dynreg.gait.trials import TURNS, Trials
from dynreg.rng import stream
from dynreg.search.drive import Limits
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES

STEP = 0.05  # of the ranges, 1 sigma, at first: our own choice
# Of the ranges, 1 sigma, by which parameters move. Answers of queries about two quadrupeds were off by 0.11 to 0.28
# (RMS over the parameters); with 0.03, a search went beyond what the robot could still walk.
DOUBT = 0.1
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the way from the gait to what the search found: our own choice
# Both by eight quadrupeds of the development alone; `rounds` of bench_gait_hidden has what they bring on others.
# Share of the runs by which a gait may fall more often than the one that walked.
MORE_FALLS = 0.05
# Share of the rollouts in which all points of the way are tried: a gait that falls in 10 % of its runs needs about a
# hundred to show it.
LOOK = 0.35


def may_stay(method: str) -> bool:
    """Whether a search can stay near a gait: it sets out from one point, and learns from each batch alone."""
    return SEARCHES[method].from_one and SEARCHES[method].by_order


def most_simulators(rollouts: int) -> int:
    """In how many simulators all points of the way can be tried, with so many rollouts in all."""
    return max(int(LOOK * rollouts) // len(SHARES), 1)


def seek_near(trials: Trials, settings: SearchSettings, **followed: Unpack[Followed]) -> Sought:
    """The gait between the first of `settings.tried` and what a search about it finds; the same each time.

    Each batch runs in one of the simulators, which take turns, with parameters moved by `settings.doubt` (`DOUBT`,
    usually). So the search finds which way gaits get better in all. How far to go, `farthest` says. It has no patience:
    values of batches that ran in different simulators do not compare.
    """
    space, k, kind = trials.space, len(trials.simulators), SEARCHES[settings.method]
    # runs of one draw of noise and parameters: all points of the way, in every simulator
    each = len(SHARES) * k
    # draws from `TURNS.start` on belong to the batches
    draws = min(int(LOOK * settings.rollouts) // each, TURNS.start)
    evaluations = settings.rollouts - draws * each
    begin = space.to_unit(np.array(settings.tried[:1]))[0]
    rng, steps = stream(settings.seed, "gait near", settings.method), np.full(len(space), STEP)
    search = kind.begin(Start(len(space), rng, kind.batch, begin, space.periodic, steps))
    begun, ran, stood = 0, np.zeros(k, dtype=bool), np.zeros(k, dtype=bool)

    def graded(unit: np.ndarray) -> np.ndarray:
        return trials.in_turn(space.feasible(space.from_unit(unit)), begun, 1, settings.doubt)

    def watched(grades: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal begun
        met = trials.turn(begun, 1)
        ran[met], stood[met] = True, stood[met] | ~fell(grades).all()
        begun += 1
        return fitness(grades)[:, 0], -grades[:, 0]

    found = driven(search, graded, watched, Limits(evaluations), **followed)
    best, finals = farthest(trials, settings, between(begin, search.middle, space.periodic), draws)
    return answer(trials, best, found, finals, ran & ~stood)


def between(begin: np.ndarray, end: np.ndarray, periodic: np.ndarray) -> np.ndarray:
    """(n, P) `SHARES` of the way from one point (P,) of the unit cube to another; periodic (P,) as `Start` has it."""
    way = end - begin
    way = np.where(periodic, np.mod(way + 0.5, 1.0) - 0.5, way)
    points = begin + np.array(SHARES)[:, None] * way
    return np.where(periodic, np.mod(points, 1.0), points)


def farthest(
    trials: Trials, settings: SearchSettings, points: np.ndarray, draws: int
) -> tuple[np.ndarray, Finals | None]:
    """The best of the points (n, P) after the first, and what it did.

    All meet the same so many draws of noise and parameters, moved by `settings.doubt`, in every simulator. Of those
    that fall no more often than the first, but for `MORE_FALLS`, the highest gain over it is taken: accepted over the
    simulators, of the mean over draws. So a simulator that is wrong about how far a gait goes does not decide alone.
    Where all fall more often, it is the one that falls least.

    Without draws it is the point half way, and None.
    """
    if not draws:
        return points[SHARES.index(0.5)], None
    space, accepted = trials.space, ACCEPT[settings.accept]
    seen = trials.again(space.feasible(space.from_unit(points)), draws, doubt=settings.doubt)
    values = fitness(seen).mean(axis=1)
    gains, falls = accepted(values[1:] - values[0]), fell(seen).mean(axis=(1, 2))
    risky = falls[1:] > falls[0] + MORE_FALLS
    best = 1 + int(np.lexsort((-gains, np.where(risky, falls[1:], 0.0)))[0])
    return points[best], Finals(seen[best].size, int(fell(seen[best]).sum()), float(accepted(values)[best]))
