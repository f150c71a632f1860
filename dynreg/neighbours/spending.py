"""What a query spends: how many of its replays look for candidates, make a simulator, and tell its intervals."""

from dataclasses import dataclass

from dynreg.errors import UsageError
from dynreg.neighbours.make import Spend, of_starts
from dynreg.neighbours.sharpen import ROUNDS, cost
from dynreg.replay.start_error import noisy_channels
from dynreg.sim.robot import Robot

REPLAYED = 0.6  # share of the search that replays candidates; the rest synthesises
AGAIN = 2  # rounds that sharpen the answer once more, from better start states
HALVED = 1  # replay with half the time step, for the intervals


@dataclass(frozen=True)
class Unknown:
    """How many parameters are free, and how many channels state a noise, so that their start states may be wrong."""

    free: int
    noisy: int


@dataclass(frozen=True)
class Spending:
    """What a query spends: the k nearest are replayed in any case, others where `replay`; `budget` replays in all.

    synthesise : whether a simulator is made of them. Raises UsageError where the budget does not suffice.
    """

    k: int
    budget: int
    replay: bool = True
    synthesise: bool = True

    def __post_init__(self) -> None:
        if self.budget < self.k + 2:
            raise UsageError(
                f"a budget of {self.budget} replays",
                expected=f"at least {self.k + 2} for k = {self.k}",
                do="raise --budget or lower -k",
            )

    def entries(self, taken: int, unknown: Unknown) -> int:
        """How many entries are replayed where so many other candidates are; see `search`."""
        if not self.replay:
            return self.k
        room = round(REPLAYED * self.search(unknown)) if self.synthesise else self.budget
        return max(self.k, room - taken)

    def search(self, unknown: Unknown) -> int:
        """Replays that look for the region of the answer. The rest tells errors of start states, and sharpens it."""
        least = min(self.budget, _usual_search(unknown.free, self.k))
        return max(least, self.budget - _sharpening(unknown))

    def starts(self, unknown: Unknown) -> bool:
        """Whether the budget suffices for errors of start states, with rounds that sharpen the answer."""
        least = of_starts(unknown.noisy) + (1 + AGAIN) * cost(unknown.free) + HALVED
        return unknown.noisy > 0 and self.budget >= self.search(unknown) + least

    def to_make(self, taken: int, unknown: Unknown) -> Spend:
        """What is left to make a simulator of so many replays."""
        search, again = self.search(unknown), AGAIN * cost(unknown.free)
        rest = self.budget - search - HALVED
        if not self.starts(unknown):
            return Spend(search - taken, rest, 0)
        return Spend(search - taken, rest - again - of_starts(unknown.noisy), again)


def usual_budget(robot: Robot, k: int) -> int:
    """Most simulators that a query replays to choose its answer."""
    unknown = Unknown(len(robot.space), len(noisy_channels(robot)))
    return _usual_search(unknown.free, k) + _sharpening(unknown)


def _usual_search(parameters: int, k: int) -> int:
    """Each parameter needs two replays to be told from the others."""
    return max(18 + 2 * parameters, k + 12)


def _sharpening(unknown: Unknown) -> int:
    """Most replays that follow the search."""
    rounds = ROUNDS + (AGAIN if unknown.noisy else 0)
    return of_starts(unknown.noisy) + rounds * cost(unknown.free) + HALVED
