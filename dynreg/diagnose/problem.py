"""Problem: all that a search for causes needs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynreg.data.recording import Recording
from dynreg.diagnose.plans import Plan, plan_for
from dynreg.diagnose.ranking.guide import Guide
from dynreg.evidence.accuracy import rough
from dynreg.evidence.data import Data
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.slopes import uneven
from dynreg.replay.parts import train_part
from dynreg.sim.effects import Term
from dynreg.sim.effects.contact import can_touch
from dynreg.sim.engine import ENGINES


@dataclass(frozen=True, eq=False)
class Problem:
    """A model, the data to explain, the candidate terms, and the plan of the search.

    guide : a population that tells which terms are likely; None without one.
    """

    model: Model
    data: Data
    terms: tuple[Term, ...]
    plan: Plan
    guide: Guide | None = None

    def train_part(self, recording: Recording) -> Recording:
        """The rows of its recording that the search may look at: all but the test part."""
        return train_part(self.model.robot, recording, self.data.windows, self.data.parts)


def planned(model: Model, data: Data, terms: Sequence[Term]) -> Search[Problem]:
    """The problem with its accuracy and plan; a search depends on nothing else."""
    sliding = not model.accuracy.fine and ENGINES[model.running].contacts and can_touch(model.robot)
    if sliding and (yield from uneven(model, model.start, data.sample(data.fit))):
        model = replace(model, accuracy=rough(model.robot, model.engine))
    return Problem(model, data, tuple(terms), plan_for(model, terms))
