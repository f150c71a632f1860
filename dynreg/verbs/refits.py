"""What was fitted to several recordings, as results."""

from dynreg.diagnose.refitted import Refit, Value
from dynreg.results.refit import Refit as RefitResult
from dynreg.results.result import Interval


def told(one: Refit) -> RefitResult:
    """A size or a parameter in several recordings, as a result."""
    return RefitResult(**fields_of(one))


def fields_of(one: Refit) -> dict[str, object]:
    """The fields that results about a size or a parameter in several recordings share."""
    values = {name: interval_of(value, one.unit) for name, value in one.values.items()}
    return vars(one) | {"values": values, "together": interval_of(one.together, one.unit)}


def interval_of(value: Value, unit: str) -> Interval:
    """A value with its 90 % interval, as a result."""
    return Interval(value=value.value, low=value.low, high=value.high, unit=unit)
