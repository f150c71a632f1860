"""Judge the answer of a query: its error, held against those that robots of the family would leave.

Robots of the family are simulated: twins of the answer (`evidence/twins.py`), which are it in all but what time step,
drives and sensors do. An answer that is right errs as it does against its twins. Where the recording holds runs of the
same commands that differ by more than those of a twin, the robot itself is so unsteady: what it does not repeat, no
simulator can tell.

A search may give up on its way. The linear model about the answer says so: it promises much less error than there is,
round after round, for the way bends. Only what no choice of parameters takes away is the model's, so the error that is
held against the limit is what would be left if the promise were kept twice. (Servos of the family: of 29 that tuned
this, one was left at 2.6 times its twins' error with a promise of 0.55, one at 1.4 with 0.80, others near 1 with at
least 0.98; with a cause the promise is above 0.96.)

An answer that nobody sharpened is held against the same limit, whatever its search left: above it the answer is not
close, and only a search can say whether another simulator of the family is. (The best of those replayed were once taken
for the robot in turn, each with the best of the others for its answer. Thirty simulators of a cartpole that lie far
apart then gave a limit of 34 times the usual error, and "use" was said where a sharpened answer, nearer by far, rang.)
"""

from dataclasses import dataclass

import numpy as np

from dynreg.evidence.lockstep import run
from dynreg.evidence.twins import twins
from dynreg.replay.repeatability import repeated_windows
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.engine import ENGINES

# Twins, and where simulators are stepped one by one: with eight, a query of the leg took 1.4 to 1.5 times as long.
TWINS, FEWER = 8, 5
SURE = 0.99  # of the errors that one more robot of the family would leave, by those of the twins, below the limit
# Of the usual error, the least that the limit is: a search ends near the best parameters, not at them.
LEAST = 1.5


@dataclass(frozen=True)
class Judgement:
    """The error of a query's answer beside the errors that robots of the family would leave.

    error : of the answer; usual : median of those of robots of the family; limit : what one more of these would stay
    below, infinite where they are too few to tell. unsteady : how many times larger both are as the robot repeats its
    runs less well than twins do, 1 where it does not. repeats : pairs of runs by which this is known. sharpened :
    whether a search about the answer has looked for a better one. promised : share of the error that the linear model
    about the answer would leave; 1 where its search has ended, and where there was none.
    """

    error: float
    usual: float
    limit: float
    unsteady: float
    repeats: int
    sharpened: bool
    promised: float

    @property
    def misfit(self) -> float:
        """The error over the usual one."""
        return self.error / self.usual

    @property
    def misfit_limit(self) -> float | None:
        """The limit over the usual error; None where robots of the family were too few to tell it."""
        return self.limit / self.usual if np.isfinite(self.limit) else None

    @property
    def fits(self) -> bool:
        """Whether the answer errs no more than those of robots of the family would, or its search had not ended."""
        return self.error * self.promised**2 <= self.limit

    @property
    def ended(self) -> bool:
        """Whether the answer stays on its side of the limit where its search goes on."""
        return self.fits == (self.error <= self.limit)


def judge(
    replayer: Replayer, values: np.ndarray, chosen: np.ndarray, seed: int, *, promised: float | None
) -> Judgement:
    """The judgement of the answer, with parameters (1, P), in the windows `chosen`.

    promised : see `sharpen.promised`; None where it was not sharpened.
    """
    robot, windows = replayer.robot, replayer.windows.take(chosen)
    many = TWINS if ENGINES[next(iter(robot.engines))].vectorised else FEWER
    states = replayer.states(values, chosen)
    measured = run(twins(robot, windows, np.repeat(values, many, axis=0), seed), threads=replayer.threads)
    error = float(errors(replayer.against(states, windows.measured)).mean())
    left = np.array([float(errors(replayer.against(states, one)).mean()) for one in measured])
    usual = float(np.median(left))
    limit = max(_limit(left), LEAST * usual)
    pairs = repeated_windows(robot, windows)
    unsteady = _unsteady(replayer, windows.measured, measured, pairs, usual)
    return Judgement(
        error=error,
        usual=usual * unsteady,
        limit=limit * unsteady,
        unsteady=unsteady,
        repeats=len(pairs),
        sharpened=promised is not None,
        promised=1.0 if promised is None else promised,
    )


def _limit(left: np.ndarray) -> float:
    """What one more of errors (n,) stays below: a prediction interval of their logarithms; infinite for a single one.

    By Student's distribution: few errors make it wide.
    """
    from scipy.stats import t

    size, many = np.log(np.maximum(left, 1e-12)), len(left)
    if many < 2:
        return np.inf
    above = t.ppf(SURE, many - 1) * size.std(ddof=1) * np.sqrt(1.0 + 1.0 / many)
    with np.errstate(over="ignore"):
        return float(np.exp(size.mean() + above))


def _unsteady(
    replayer: Replayer, measured: np.ndarray, of_twins: np.ndarray, pairs: np.ndarray, usual: float
) -> float:
    """How many times larger than usual an error is by what the robot repeats less well than twins (n, W, T+1, S) do.

    pairs : (R, 2) windows of the same commands. The noise of two runs is in their difference, that of one in an error.
    """
    if not len(pairs):
        return 1.0
    first, second = pairs.T
    log, *others = (
        float(np.nanmean(np.abs(replayer.against(one[None, first], one[second]))))
        for one in (measured, *of_twins)
    )
    if log <= _limit(np.array(others)):
        return 1.0
    more = (log**2 - float(np.median(others)) ** 2) / 2.0
    return float(np.sqrt(1.0 + more / max(usual, 1e-12) ** 2))
