"""The gaits that a robot has had."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from dynreg.errors import UsageError


@dataclass(frozen=True)
class Had:
    """m gaits that the robot has had, one trial of each.

    genes (m, G). reached (m,) : the fitness there. walked (m,) : whether it stood, and reached the task's `success`.
    simulators : ids of those in which they were sought.

    Raises UsageError where the lengths differ.
    """

    genes: tuple[tuple[float, ...], ...] = ()
    reached: tuple[float, ...] = ()
    walked: tuple[bool, ...] = ()
    simulators: tuple[str, ...] = ()

    def __post_init__(self):
        if not len(self.genes) == len(self.reached) == len(self.walked):
            raise UsageError(
                f"{len(self.genes)} gaits, {len(self.reached)} values and {len(self.walked)} ends of trials",
                expected="one trial of each gait",
                do="give as many of each",
            )

    def ordered(self, numbers: Iterable[int]) -> "Had":
        """The same gaits in another order."""
        at = list(numbers)
        genes, reached, walked = (tuple(of[i] for i in at) for of in (self.genes, self.reached, self.walked))
        return replace(self, genes=genes, reached=reached, walked=walked)
