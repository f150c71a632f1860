"""The unicycle's six parameters from a log, by the genetic algorithm of the paper on wheeled robots."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from dynreg.rng import stream
from dynreg.search.drive import Limits, drive
from dynreg.search.genetic import Genetic, Rules
from dynreg.timed.commands import FINE, Commands
from dynreg.timed.unicycle import unicycle

# a1 to a6: the lags and drags of published robots from a Khepera to a wheelchair, and couplings beyond theirs
RANGES = np.array([[0.01, 0.5], [0.01, 0.5], [-0.02, 0.02], [0.8, 1.2], [-0.1, 0.1], [0.8, 1.2]])
STEP = 0.02  # s at most: twice that of the model is as good for lags that robots have, and half the work
AT_ONCE = 20  # candidates in one batch: what fits the cache


@dataclass(frozen=True, eq=False)
class Fitted:
    """Six parameters (6,), their errors on what was fitted and on the validation part, and the best so far.

    An error is the mean over commands of the squares of the three displacements' errors, each over its variance,
    which is never taken for less than that of `FINE`. history : (generations,) the lowest error of every generation.
    """

    parameters: np.ndarray
    error: float
    validation: float
    history: np.ndarray


@dataclass(frozen=True)
class Breeding:
    """How long, and of how many, the genetic algorithm breeds; by default as published."""

    generations: int = 1000
    population: int = 200
    tournament: int = 40
    seed: int = 0


BREEDING = Breeding()


def fit_unicycle(
    commands: Commands,
    moved: np.ndarray,
    validation: tuple[Commands, np.ndarray],
    track: float,
    breeding: Breeding = BREEDING,
    *,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Fitted:
    """The six parameters that explain displacements (n, 3) of commands (n,) best.

    Of the best of every generation the one with the lowest error on `validation` is kept (Pretorius et al.).
    threads : that simulate side by side; they change no number. progress : called with generations done and all.
    """
    variance = np.maximum(moved.var(axis=0), FINE**2)  # rounding alone moves an axis that is not driven
    rng, population = stream(breeding.seed, "fit unicycle"), breeding.population
    search = Genetic(6, rng=rng, rules=Rules(population, breeding.tournament))
    parameters = lambda unit: RANGES[:, 0] + unit * np.ptp(RANGES, axis=1)  # noqa: E731
    history: list[float] = []
    with ThreadPoolExecutor(threads) as pool:
        errors_of = partial(_errors, variance=variance, track=track, pool=pool)

        def grades(unit: np.ndarray) -> np.ndarray:
            """(n, 2) errors on what is fitted, and on the validation part: infinite but for the best of them."""
            asked, unseen = parameters(unit), np.full(len(unit), np.inf)
            errors = errors_of(asked, commands, moved)
            at = int(np.argmin(np.where(np.isfinite(errors), errors, np.inf)))
            history.append(float(errors[at]))
            found = errors_of(asked[[at]], *validation)[0]
            unseen[at] = found if np.isfinite(found) else np.inf  # it diverges there: anything else is better
            return np.stack([errors, unseen], axis=1)

        found = drive(
            search,
            grades,
            lambda both: (-both[:, 1], both[:, 0]),
            Limits(breeding.generations * population),
            progress=progress and (lambda done, _: progress(done // population, breeding.generations)),
        )
    error, unseen = (float(x) for x in found.grades)
    return Fitted(parameters(found.best), error, unseen, np.array(history))


def _errors(
    parameters: np.ndarray,
    commands: Commands,
    moved: np.ndarray,
    *,
    variance: np.ndarray,
    track: float,
    pool: ThreadPoolExecutor,
) -> np.ndarray:
    """(B,) of parameters (B, 6); NaN where a simulation is no number."""

    def errors(some: np.ndarray) -> np.ndarray:
        found = unicycle(commands, some, track, step=STEP)
        with np.errstate(over="ignore", invalid="ignore"):
            return ((found - moved) ** 2 / variance).sum(axis=2).mean(axis=1)

    batches = [parameters[at : at + AT_ONCE] for at in range(0, len(parameters), AT_ONCE)]
    return np.concatenate(list(pool.map(errors, batches)))
