"""Plans: how a diagnosis is searched for, by what its rollouts cost and how rough they are; one is chosen, once."""

from collections.abc import Sequence

from dynreg.diagnose.plans.contact import Contact
from dynreg.diagnose.plans.feet import Feet
from dynreg.diagnose.plans.long import Long
from dynreg.diagnose.plans.many import Many
from dynreg.diagnose.plans.plan import Plan
from dynreg.diagnose.plans.short import Short
from dynreg.evidence.model import Model
from dynreg.sim.effects import Term

# Two joints, and all that can be wrong with each: as a long list they take a tenth of the rollouts (double pendulum).
LONG = 40  # terms from which a list is long


def plan_for(model: Model, terms: Sequence[Term]) -> Plan:
    """The plan of a search for one of these terms."""
    if len(terms) <= LONG:
        return Many() if model.dear else Short()
    if model.robot.floating:
        return Feet()
    return Contact() if model.accuracy.fine else Long()


__all__ = ["Contact", "Feet", "Long", "Many", "Plan", "Short", "plan_for"]
