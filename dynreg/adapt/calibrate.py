"""Calibrate: fit a robot's parameters to a recording by a search over replays, the usual way."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.replay.data import Data
from dynreg.replay.residual import MOST
from dynreg.replay.windows import Replayer, errors
from dynreg.rng import stream
from dynreg.search.drive import Limits, drive
from dynreg.search.screened import after
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What a search found: unit parameters (P,), and replay errors of what it began with and of these.

    train, test : (2,) on what it looked at and on what was held out, NaN where nothing was. history : (replays, lowest
    error) whenever it fell, and at the end; no number of replays twice. rollouts, test_rollouts : replays in all.
    """

    unit: np.ndarray
    train: tuple[float, float]
    test: tuple[float, float]
    history: tuple[tuple[int, float], ...]
    rollouts: int
    test_rollouts: int


def calibrate(
    data: Data,
    search: str,
    *,
    budget: int,
    seed: int = 0,
    threads: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Calibrated:
    """The parameters with the lowest replay error on everything that is not held out, never worse than `data.start`.

    search : one of the table. What it begins with is tried first; what the recording tells stays as it is. budget :
    replays at most, each one candidate through all windows that are not held out.
    """
    space, replayer = data.robot.space, Replayer(data.robot, data.windows, threads)
    free, start = np.flatnonzero(np.isnan(data.known)), space.to_unit(data.start)

    def whole(some: np.ndarray) -> np.ndarray:
        unit = np.tile(start, (len(some), 1))
        unit[:, free] = some
        return unit

    def losses(unit: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        return errors(replayer.residuals(data.values_of(unit), chosen)).mean(axis=1)

    kind = SEARCHES[search]
    begin = Start(len(free), stream(seed, "calibrate", data.robot.name), kind.batch)
    found = drive(
        after(start[None, free], kind, begin),
        lambda some: losses(whole(some), data.parts.chosen)[:, None],
        # climbers take losses below 0 for ground, and a diverged simulation's is 0
        lambda grades: (-grades[:, 0], grades[:, 0] - MOST),
        Limits(budget if len(free) else 1, cut=True),
        progress=progress,
    )
    pair = np.stack([start, whole(found.best[None])[0]])
    test = np.flatnonzero(data.parts.test)
    tested = losses(pair, test) if len(test) else np.full(2, np.nan)
    history = {spent: -value for spent, value in (*found.history, (found.evaluations, found.value))}
    lowest = tuple(history.values())
    return Calibrated(
        unit=pair[1],
        train=(lowest[0], lowest[-1]),
        test=(float(tested[0]), float(tested[1])),
        history=tuple(history.items()),
        rollouts=found.evaluations,
        test_rollouts=2 * bool(len(test)),
    )
