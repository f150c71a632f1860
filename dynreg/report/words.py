"""Short numbers and counts, as every room says them."""

from collections.abc import Sequence

from dynreg.errors import taken_apart
from dynreg.results.diagnosis import EffectEstimate
from dynreg.results.result import Cost, Estimate


def number(value: float | int | None) -> str:
    """Three digits, as people read them; `-` where there is none.

    >>> number(0.123456), number(1234.5), number(7), number(None)
    ('0.123', '1234', '7', '-')
    """
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"


def count(how_many: int, what: str) -> str:
    """A number of things.

    >>> count(1, "simulation"), count(2, "simulation")
    ('1 simulation', '2 simulations')
    """
    return f"{how_many} {what}{'' if how_many == 1 else 's'}"


def interval(estimate: Estimate | EffectEstimate) -> str:
    """Value with its 90 % interval, where it has one, marked where it lies on the edge of the range."""
    edge = " (at the edge)" if estimate.at_bound else ""
    bounds = "" if estimate.low is None else f" [{number(estimate.low)}, {number(estimate.high)}]"
    return f"{number(estimate.value)}{bounds}{edge}"


def cost_words(cost: Cost) -> str:
    """What a search cost."""
    return f"cost: {cost.evaluations} distance evaluations, {cost.rollouts} simulations, {cost.seconds:.1f} s"


def first_of(problems: Sequence[str]) -> tuple[str, str, str]:
    """The first problem in its own words, (problem, expected, do), and how many more there are."""
    problem, expected, do = taken_apart(problems[0])
    return problem + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""), expected, do
