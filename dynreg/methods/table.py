"""The table of methods, one line each; without heavy imports.

A method is a class with `needs` and `fit` (see `calibrator.Calibrator`), and a line here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from dynreg.search.table import SEARCHES

if TYPE_CHECKING:
    from dynreg.methods.calibrator import Calibrator


@dataclass(frozen=True)
class Kind:
    """One method: its name, "module:class" that makes it of that name, and what it needs beside the recording.

    needs : "population", "plan" or "wheels". usual : simulations where no number is asked for; None where the method
    has its own. starts : whether it begins with a simulator. about : when to use it.
    """

    name: str
    where: str
    about: str
    needs: tuple[str, ...] = ()
    usual: int | None = None
    starts: bool = True

    def made(self) -> "Calibrator":
        """The method."""
        module, _, name = self.where.partition(":")
        return getattr(import_module(f"dynreg.methods.{module}"), name)(self.name)


SEARCHED = "by_search:BySearch"
USUAL = 600  # simulations of a search
GENETIC = {"genetic": "ga"}  # a search, and what it is called as a method: the papers' word
_ABOUT = {
    "cma": "The usual choice among searches.",
    "hill": "The hill climber of paper D, for a start that is nearly right.",
    "random": "What every other method must beat.",
    "ga": "The genetic algorithm of paper A.",
    "bits": "A genetic algorithm on bits.",
    "operon": "The operon algorithm of paper C.",
    "es": "The evolution strategy of paper E, all parameters at once.",
    "policy": "The policy gradient of paper B, about a good start.",
    "roulette": "The genetic algorithm of paper B.",
}

METHODS: Mapping[str, Kind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            Kind(
                "nearest",
                "by_query:Nearest",
                "Paper D: the nearest of registered simulators.",
                ("population",),
                starts=False,
            ),
            Kind(
                "synthesis",
                "by_query:Synthesis",
                "A simulator made of the nearest ones.",
                ("population",),
                starts=False,
            ),
            *(
                Kind(name, SEARCHED, _ABOUT[name], usual=USUAL)
                for name in (GENETIC.get(search, search) for search in SEARCHES)
            ),
            Kind(
                "staged",
                "by_stages:Staged",
                "Paper E: parameters in stages, each by its own plan.",
                ("plan",),
            ),
            Kind("diagnose", "by_diagnosis:ByDiagnosis", "Parameters and physical causes together."),
        )
    }
)
