"""The table of methods, one line each; without heavy imports.

A method is a class with `fit` (see `calibrator.Calibrator`), and a line here.
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
    """One method: its name, "module:class" of it, and when to use it.

    needs : what it cannot do without: "plan", "population", "wheels" of the robot, or "trials" of a "task" on the robot
    itself, in place of a recording. reads : further settings that mean something to it, of "start", "budget" and
    "resume", and of trials "seconds", "falls", "goal" and "search".
    """

    name: str
    where: str
    about: str
    needs: tuple[str, ...] = ()
    reads: tuple[str, ...] = ("start", "budget", "resume")

    @property
    def tries(self) -> bool:
        """Whether it tries the robot itself, and reads no recording."""
        return "trials" in self.needs

    def takes(self, setting: str) -> bool:
        """Whether a setting means something to it; a part of the recording is held out by all that read one."""
        return setting in (*self.needs, *self.reads) or (setting == "hold_out" and not self.tries)

    def made(self) -> "Calibrator":
        """The method."""
        module, _, name = self.where.partition(":")
        kind = getattr(import_module(f"dynreg.methods.{module}"), name)
        return kind(self.name) if self.where == SEARCHED else kind()


SEARCHED = "by_search:BySearch"
USUAL = 600  # simulations of a search: our choice
_ABOUT = {
    "cma": "the usual choice among searches",
    "hill": "the hill climber of paper D, a plain local search",
    "random": "draws from the whole range, wherever it begins: what every other method must beat",
    "ga": "the genetic algorithm of paper A, where there are many optima",
    "bits": "a genetic algorithm on bits, as the reference of `operon`",
    "operon": "the algorithm of paper C, for hundreds of parameters",
    "es": "the evolution strategy of paper E, for thousands of simulations",
    "policy": "the policy gradient of paper B, near a good start",
    "roulette": "the genetic algorithm of paper B, for thousands of simulations",
}
_REGISTERED = {"needs": ("population",), "reads": ("budget",)}

METHODS: Mapping[str, Kind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            Kind(
                "nearest",
                "by_query:Nearest",
                "the registered simulator that moves most like the robot (paper D), where nothing shall be fitted",
                **_REGISTERED,
            ),
            Kind(
                "synthesis",
                "by_query:Synthesis",
                "a simulator made of the nearest ones, with intervals, from few simulations",
                **_REGISTERED,
            ),
            *(Kind(name, SEARCHED, f"all parameters at once: {_ABOUT[name]}") for name in SEARCHES),
            Kind(
                "staged",
                "by_stages:Staged",
                "parameters in stages (paper E), where each recording shows one thing",
                needs=("plan",),
            ),
            Kind(
                "ttest",
                "by_ttest:ByTTest",
                "gains of a robot on wheels (paper C), where it changes while it is recorded",
                needs=("wheels",),
                reads=("start", "budget"),
            ),
            Kind(
                "diagnose",
                "by_diagnosis:ByDiagnosis",
                "parameters and physical causes together, where the model lacks something",
                reads=("start",),
            ),
            Kind(
                "btr",
                "by_reality:ByReality",
                "parameters and a gait in turn (paper B), where a score of each trial is all that is measured",
                needs=("trials", "task"),
                reads=("start", "budget", "resume", "seconds", "falls", "goal", "search"),
            ),
        )
    }
)
