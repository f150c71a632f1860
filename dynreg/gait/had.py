"""The gaits that a robot has had."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Had:
    """m gaits that the robot has had, one trial of each.

    genes (m, G). reached (m,) : the fitness there. fell (m,) : whether it fell. walked : whether one walked.
    simulators : ids of those in which they were sought.
    """

    genes: tuple[tuple[float, ...], ...] = ()
    reached: tuple[float, ...] = ()
    fell: tuple[bool, ...] = ()
    walked: bool = False
    simulators: tuple[str, ...] = ()

    def ordered(self, numbers: Iterable[int]) -> "Had":
        """The same gaits in another order."""
        at = list(numbers)
        genes, reached, fell = ([of[i] for i in at] for of in (self.genes, self.reached, self.fell))
        return Had((*genes,), (*reached,), (*fell,), self.walked, self.simulators)
