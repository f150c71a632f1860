"""All parameters at once, by a search of the table over replays: the usual way."""

import numpy as np

from dynreg.adapt.searched import searched
from dynreg.methods.answer import Answer, Version
from dynreg.methods.calibrator import Evidence, Limits, Question, episodes_of, seconds_of
from dynreg.methods.table import USUAL
from dynreg.replay.residual import MOST
from dynreg.replay.windows import Replayer, errors
from dynreg.rng import stream
from dynreg.search import drive
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES


class BySearch:
    """The search whose method is called `name`: the parameters with the lowest replay error that it finds.

    What it begins with is tried first, and what the recording tells stays as it is.
    """

    def __init__(self, name: str):
        self._name = name
        self._kind = SEARCHES[name]

    def fit(self, question: Question, evidence: Evidence, limits: Limits) -> Answer:
        """One version, never worse than what it begins with on what is not held out."""
        data = question.data
        replayer = Replayer(data.robot, data.windows, limits.threads)
        free = np.flatnonzero(question.free)
        rng = stream(limits.seed, "calibrate", data.robot.name)
        found = searched(
            lambda unit: errors(replayer.residuals(data.values_of(unit), data.parts.chosen)).mean(axis=1),
            question.begin,
            free,
            lambda point: self._kind.begin(Start(len(free), rng, self._kind.batch, point)),
            drive.Limits(limits.simulations or USUAL, cut=True),
            most=MOST,
            journal=limits.journal(self._name),
            progress=limits.progress and (lambda done, total: limits.progress("calibrate", done, total)),
        )
        made = Version(
            self._name,
            data.values_of(found.unit),
            None,
            episodes_of(question),
            found.first,
            found.last,
            history=found.history,
        )
        simulated = found.evaluations * seconds_of(question)
        return Answer(
            (made,), found.ended, found.evaluations, simulated, resumed=found.resumed, free=question.free
        )
