"""The table of searches, one line each, and how any of them is begun; without heavy imports.

A search is a class of `turns.Turns`, a function that begins it, and a line here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynreg.search.drive import Search
    from dynreg.search.start import Start


@dataclass(frozen=True)
class Kind:
    """One search: its name, "module:function" that begins it, and its candidates of one ask.

    by_order : it learns from the order of the losses of one batch alone: they may have any scale, and other noise in
    every batch. from_one : it sets out from one point, and looks about there.
    """

    name: str
    where: str
    batch: int = 10
    by_order: bool = False
    from_one: bool = False

    def begin(self, start: "Start") -> "Search":
        """The search, about to ask for its first candidates. Raises UsageError for a batch that it refuses."""
        module, _, function = self.where.partition(":")
        return getattr(import_module(f"dynreg.search.{module}"), function)(start)

    def require(self, batch: int) -> None:
        """UsageError where the search refuses so many candidates of one ask; before time is spent on anything."""
        from dynreg.rng import stream
        from dynreg.search.start import Start

        self.begin(Start(2, stream(0, "any"), batch))  # no search refuses a batch because of its dimensions


FORMER: Mapping[str, str] = MappingProxyType({"cmaes": "cma", "genetic": "ga"})
"""{former name: name}: what a user types may have it, and so may stored plans and documents."""

SEARCHES: Mapping[str, Kind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            Kind("cma", "cmaes:begin", by_order=True, from_one=True),
            Kind("hill", "hill:begin", batch=5),
            Kind("random", "at_random:begin"),
            Kind("ga", "genetic:begin", by_order=True),
            Kind("bits", "bits:begin_plain", by_order=True),
            Kind("operon", "bits:begin_operon", by_order=True),
            Kind("roulette", "bits:begin_roulette", batch=20),
            Kind("es", "strategy:begin", batch=25, by_order=True, from_one=True),
            Kind("policy", "policy:begin", batch=15, from_one=True),
        )
    }
)
