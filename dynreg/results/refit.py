"""An answer fitted to each of several recordings: what is the same in all of them, and what differs."""

from dynreg.data.units import suffix
from dynreg.results.result import Interval, Result


class Refit(Result):
    """One parameter of a simulator, or one size of a cause in it, fitted to several recordings.

    cause : its key; null for a parameter of the robot. values : by recording, with 90 % intervals. Where they
    differ, they are fitted with all other values shared. same : one value fits all of them, `together`. nats : the
    evidence that they differ. there : recordings in which the whole interval of the cause is above its threshold.
    absent : those in which the cause may be absent; both are empty for a parameter.
    """

    cause: str | None
    parameter: str
    unit: str
    values: dict[str, Interval]
    together: Interval
    same: bool
    nats: float
    there: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The parameter, with its cause where it is one of a cause."""
        return f"{self.cause} ({self.parameter})" if self.cause else self.parameter

    def __str__(self) -> str:
        if self.same:
            return f"{self.name}: same in all, {sized(self.together)}"
        if self.there and self.absent:
            told = " and ".join(f"{name} ({sized(self.values[name])})" for name in self.there)
            return f"{self.name}: only in {told}"
        return (
            f"{self.name}: differs, {', '.join(f'{sized(v)} in {name}' for name, v in self.values.items())}"
        )


def sized(e: Interval, signed: bool = False) -> str:
    """A number with its interval and unit.

    >>> sized(Interval(value=0.5, low=0.4, high=0.62, unit="kg"), signed=True)
    '+0.5 [0.4, 0.62] kg'
    """
    sign = "+" if signed and e.value >= 0 else ""
    return f"{sign}{e.value:.3g} [{e.low:.3g}, {e.high:.3g}]{suffix(e.unit)}"
