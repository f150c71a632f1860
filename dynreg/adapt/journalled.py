"""Trials on a robot whose beginnings and outcomes are kept, so that none is played twice and each is counted."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynreg.errors import CorruptError
from dynreg.search.journal import Journal


@dataclass(frozen=True)
class Outcome:
    """What a trial came to.

    score : in the task's unit; None for a fall. seconds : how long it lasted [s]. number : of the run's trials, from 1.
    ever : of all trials of the robot, those before this run too. lost : nothing tells how it ended; it has no score.
    """

    score: float | None
    seconds: float
    number: int
    ever: int
    lost: bool = False

    @property
    def fell(self) -> bool:
        """Whether the robot is known to have fallen."""
        return self.score is None and not self.lost

    @property
    def row(self) -> np.ndarray:
        """(1, 6) numbers that a journal keeps."""
        told = (self.score or 0.0, self.score is None, self.seconds, self.number, self.ever, self.lost)
        return np.array([told], dtype=float)


def trial_name(number: int) -> str:
    """What the robot's door, and all who tell of it, call a trial of a run."""
    return f"trial_{number}"


def outcome_of(row: np.ndarray) -> Outcome:
    """The inverse of `Outcome.row`; CorruptError for a row of another form."""
    if row.shape != (1, 6):
        raise CorruptError(
            f"the journal of the trials has {row.shape[-1]} numbers of a trial",
            expected="6, as this version of dynreg writes them",
            do="begin anew with another seed",
        )
    score, none, seconds, number, ever, lost = row[0].tolist()
    return Outcome(None if none else score, seconds, int(number), int(ever), bool(lost))


@dataclass(frozen=True)
class Journalled:
    """Trials by `trial`; what the journal holds is not played again, but told to `again`.

    begin : what the next trial costs if it is lost; BudgetError where it may not be played. It is kept before the robot
    moves: a trial that an error or a power cut ended has cost something, too. keeps : whether a trial that is asked for
    again gives what it left, and moves nothing, as in a folder; such a one is never lost.
    """

    begin: Callable[[], Outcome]
    trial: Callable[[np.ndarray], Outcome]
    again: Callable[[Outcome], None]
    journal: Journal | None = None
    keeps: bool = False

    def __call__(self, gait: np.ndarray) -> Outcome:
        """What a gait (G,) came to; raises as `begin` and `trial`."""
        begun: Outcome | None = None  # of which no outcome has come yet
        while (known := self._held(gait)) is not None:
            if begun is not None and known.number != begun.number:
                self.again(begun)
            if not known.lost:
                self.again(known)
                return known
            begun = known
        if begun is not None and not self.keeps:
            self.again(begun)
            begun = None
        if begun is None:
            self._keep(gait, self.begin())
        outcome = self.trial(gait)
        self._keep(gait, outcome)
        return outcome

    def _held(self, gait: np.ndarray) -> Outcome | None:
        row = None if self.journal is None else self.journal.next(gait[None])
        return None if row is None else outcome_of(row)

    def _keep(self, gait: np.ndarray, outcome: Outcome) -> None:
        if self.journal is not None:
            self.journal.add(gait[None], outcome.row)
