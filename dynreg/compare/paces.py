"""The time of predictions, compared with that of the closed form."""

from collections.abc import Mapping
from dataclasses import dataclass
from timeit import repeat

import numpy as np

from dynreg.compare.contenders import Made, Predicts
from dynreg.compare.simulated import Replayed
from dynreg.timed.models import Kinematic
from dynreg.timed.told import Told

ALONE = 50  # commands that are timed one by one
TIMES = 3  # timings of a model; the quickest counts
MICRO = 1e6


@dataclass(frozen=True)
class Pace:
    """Wall time for a command [us], one by one and all at once, and how many times the closed form's that is.

    one_by_one : None of a simulator, which is timed on its replay. fit : seconds that making the model took.
    """

    model: str
    one_by_one: float | None
    at_once: float
    one_by_one_ratio: float | None
    at_once_ratio: float
    fit: float


def paces(told: Told, contenders: Mapping[str, Predicts], which: np.ndarray) -> tuple[Pace, ...]:
    """Wall times of predictions of some commands (indexes); these numbers alone differ from run to run."""
    alone, together = pace(Made(Kinematic(told.track), told), which)
    out = []
    for name, contender in contenders.items():
        one, at_once = pace(contender, which)
        out.append(
            Pace(
                model=name,
                one_by_one=one,
                at_once=at_once,
                one_by_one_ratio=None if one is None else one / alone,
                at_once_ratio=at_once / together,
                fit=contender.seconds if isinstance(contender, Made) else 0.0,
            )
        )
    return tuple(out)


def pace(contender: Predicts, which: np.ndarray) -> tuple[float | None, float]:
    """Microseconds for a command, one by one and all at once; a simulator's from its replay."""
    if isinstance(contender, Replayed):
        return None, MICRO * contender.seconds / len(contender.told.commands)
    alone = [which[i : i + 1] for i in range(min(ALONE, len(which)))]
    one = min(repeat(lambda: [contender.moved(single) for single in alone], number=1, repeat=TIMES))
    together = min(repeat(lambda: contender.moved(which), number=1, repeat=TIMES))
    return MICRO * one / len(alone), MICRO * together / len(which)
