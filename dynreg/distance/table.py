"""The table of distances between a recording and a population's entries; without heavy imports.

A distance is a function of a `query.DistanceQuery`, and a line here.
"""

from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynreg.distance.query import DistanceQuery, Ranked

AUTO = "auto"  # chooses one by what the recording holds


@dataclass(frozen=True)
class Distance:
    """One distance: its name, "module:function" of `dynreg.distance`, and what it looks at.

    models : of one time step, which robots whose control is timed have no use for. states : the entries' stored
    runs. graph : over the entries.
    """

    name: str
    where: str
    models: bool = True
    states: bool = False
    graph: bool = False

    def rank(self, asked: "DistanceQuery") -> "Ranked":
        """The entries that are allowed, nearest first."""
        module, _, function = self.where.partition(":")
        return getattr(import_module(f"dynreg.distance.{module}"), function)(asked)


DISTANCES = MappingProxyType(
    {
        one.name: one
        for one in (
            Distance("one_sided", "one_sided:rank"),
            Distance("embedding", "embedded:rank"),
            Distance("cross_loss", "linked:held_out", states=True, graph=True),
            Distance("cross_loss_train", "linked:training", states=True, graph=True),
            Distance("cross_loss_printed", "linked:printed", states=True, graph=True),
            Distance("trajectory", "trajectory:rank", states=True),
            Distance("replay", "replayed:rank", models=False),
        )
    }
)
NAMES = (AUTO, *DISTANCES)


def needs(name: str, what: str) -> bool:
    """Whether the distance looks at "states" or a "graph"; what chooses itself looks at neither."""
    return name in DISTANCES and getattr(DISTANCES[name], what)
