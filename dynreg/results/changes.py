"""The answer of `drift` for robots without wheels: what changed between two recordings of a robot."""

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from dynreg.axes import axes_for, chosen, with_intervals
from dynreg.results.diagnosis import DiagnosisTrace, RolloutError
from dynreg.results.refit import Refit, sized
from dynreg.results.result import Cost, Gain, Interval, Result

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes

SHOWN = 3  # changes that the headline names
BEFORE, AFTER = "before", "after"  # the two recordings, as `values` of a refit name them


class Change(Refit):
    """A size or a parameter in both recordings. difference : after less before, with its 90 % interval."""

    difference: Interval

    @property
    def moved(self) -> str:
        """By how much it rose or fell, with the 90 % interval."""
        e = self.difference
        size = e
        if e.value < 0:
            size = Interval(value=-e.value, low=-e.high, high=-e.low, unit=e.unit)
        return f"{self.name} {'fell' if e.value < 0 else 'rose'} by {sized(size)}"


class Left(Result):
    """What the fit to one recording leaves (root mean square), and its sensors' noise, in spreads of its motion."""

    residual: float
    noise: float


class Changes(Result):
    """What changed from an earlier recording to a recent one.

    verdict : "still true" where no value differs; "unexplained" where none does and the recent recording has an error
    all the same that neither diagnosis explains. left : by recording, `before` and `after`. gain : of `answer` over
    `began` on held-out data of the recent recording. taken : the stored diagnosis of the earlier recording that it
    began from; null where one was made.

    earlier : id of the earlier recording; chosen : it was not named, but the first of the robot. began : the simulator
    of a diagnosis of the earlier recording, from which that of the recent one began; answer : the simulator that it
    found. changes : all sizes and parameters that both recordings tell, those that changed first. threshold_nats : the
    evidence that a change needs. error : on the recent recording; nominal is that of `began`.
    """

    schema_: Literal["dynreg/changes/1"] = Field(default="dynreg/changes/1", alias="schema")
    robot: str
    recording: str
    recording_name: str
    earlier: str
    earlier_name: str
    chosen: bool
    verdict: Literal["still true", "changed", "unexplained"]
    changes: tuple[Change, ...]
    threshold_nats: float
    began: str
    answer: str
    error: RolloutError
    left: dict[str, Left] = {}
    gain: Gain | None = None
    taken: str | None = None
    traces: tuple[DiagnosisTrace, ...] = ()
    notes: tuple[str, ...] = ()
    seed: int
    cost: Cost

    @property
    def worse(self) -> bool:
        """Whether `began` predicts held-out data of the recent recording better than `answer`, as far as they tell."""
        return self.gain is not None and self.gain.worse

    @property
    def changed(self) -> tuple[Change, ...]:
        """What differs between the recordings, that with most evidence first."""
        return tuple(one for one in self.changes if not one.same)

    def rows(self) -> list[dict[str, Any]]:
        return [
            {
                "what": one.name,
                "before": one.values[BEFORE].value,
                "after": one.values[AFTER].value,
                "difference": one.difference.value,
                "low": one.difference.low,
                "high": one.difference.high,
                "unit": one.unit,
                "changed": not one.same,
                "nats": one.nats,
            }
            for one in self.changes
        ]

    def plot(self, name: str | None = None, ax: "Axes | None" = None) -> "np.ndarray":
        """Each size and parameter in both recordings, with 90 % intervals; (n,) matplotlib axes, changed ones first.

        name : only this one, as `rows` names it, which `ax` can take. Raises UsageError where there is no such one.
        """
        order = (*self.changed, *(one for one in self.changes if one.same))
        wanted = chosen([one.name for one in order], name, "parameter")
        shown = [one for one in order if one.name in wanted]
        places = axes_for(len(shown), ax, what="parameters", height=1.3)
        for place, one in zip(places, shown, strict=True):
            both = [(one.values[when], when) for when in (AFTER, BEFORE)]
            with_intervals(place, [when for _, when in both], [(e.value, e.low, e.high) for e, _ in both])
            place.set(title=f"{one.name} [{one.unit}]" + ("" if one.same else ", changed"))
            place.margins(y=0.5)
        return places

    def __str__(self) -> str:
        way = f"From {self.earlier_name} to {self.recording_name}"
        if self.verdict == "unexplained":
            return f"{way} no value changed, but neither diagnosis explains {self.recording_name}."
        if not self.changed:
            return f"{way} nothing changed that the recordings tell."
        told = [one.moved for one in self.changed[:SHOWN]]
        if len(self.changed) > SHOWN:
            told.append(f"{len(self.changed) - SHOWN} more values changed")
        return f"{way}, {', '.join(told[:-1])}{' and ' if told[1:] else ''}{told[-1]}."
