"""A parameter's value and interval, as results tell it."""

from dynreg.results.result import Estimate
from dynreg.sim.space import Parameter


def estimate(
    parameter: Parameter, value: float, low: float | None, high: float | None, *, at_bound: bool
) -> Estimate:
    """A value with its 90 % interval, None where there is none; at_bound : it lies on the edge of its range."""
    return Estimate(
        value=value,
        low=low,
        high=high,
        unit=parameter.unit,
        nominal=parameter.nominal,
        at_bound=at_bound,
        limits=(parameter.low, parameter.high),
    )
