"""The table of distances between a recording and a population's entries; without heavy imports.

A distance is a function of a `query.DistanceQuery`, and a line here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from dynreg.distance.query import DistanceQuery, Ranked
    from dynreg.models.mlp import MlpStack

AUTO = "auto"  # chooses one by what the recording holds


@dataclass(frozen=True)
class Distance:
    """One distance: its name, "module:function" of `dynreg.distance`, and what it looks at.

    models : of one time step, which robots whose control is timed have no use for. states : the entries' stored
    runs. judged : some held-out rows of each entry. beside : how far other models are by it, such as those of other
    recordings, where it can tell; "module:function" as well.
    """

    name: str
    where: str
    models: bool = True
    states: bool = False
    judged: bool = False
    beside: str | None = None

    def rank(self, asked: "DistanceQuery") -> "Ranked":
        """The entries that are allowed, nearest first."""
        return _found(self.where)(asked)

    def to_models(self, asked: "DistanceQuery", stack: "MlpStack") -> "np.ndarray | None":
        """(M,) distances of the recording to models of its population that are none of the entries'; None without."""
        return None if self.beside is None else _found(self.beside)(asked, stack)


def _found(where: str) -> Callable:
    module, _, function = where.partition(":")
    return getattr(import_module(f"dynreg.distance.{module}"), function)


DISTANCES = MappingProxyType(
    {
        one.name: one
        for one in (
            Distance("one_sided", "one_sided:rank", beside="one_sided:to_models"),
            Distance("embedding", "embedded:rank", beside="embedded:to_models"),
            Distance("cross_loss", "linked:held_out", judged=True),
            Distance("cross_loss_train", "linked:training", judged=True),
            Distance("cross_loss_printed", "linked:printed", judged=True),
            Distance("trajectory", "trajectory:rank", states=True),
            Distance("replay", "replayed:rank", models=False),
        )
    }
)
NAMES = (AUTO, *DISTANCES)


def needs(name: str, what: str) -> bool:
    """Whether the distance looks at "states" or "judged" rows; what chooses itself looks at neither."""
    return name in DISTANCES and getattr(DISTANCES[name], what)
