"""The answer of `query`."""

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from dynreg.results.posterior import Posterior
from dynreg.results.result import Cost, Curves, Estimate, Gain, Result, plot_curves
from dynreg.results.sentence import gain_words

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes


class Neighbour(Result):
    """One registered simulator near the recording."""

    entry: str
    name: str
    index: int
    distance: float | None
    replay_error: float | None = None
    parameters: dict[str, float]


class MeasuredNeighbour(Result):
    """Another recording whose model is registered in the population; distance : as those of the neighbours."""

    entry: str
    recording: str
    name: str
    distance: float


class Synthesised(Result):
    """The simulator that the query made from the neighbours.

    posterior : of its free parameters; null in documents that were stored before it was kept.
    """

    simulator: str
    replay_error: float
    parameters: dict[str, Estimate]
    posterior: Posterior | None = None


class Nominal(Result):
    """The parameter values of the robot folder; `replay_error` is null where nothing was replayed."""

    replay_error: float | None
    parameters: dict[str, float]


class Stage(Result):
    """One stage of the query, with its normalised replay errors (1: as large as the channel's motion).

    fit, select : on the parts that choose the answer. test : on the held-out part, which is read once, at the end.
    """

    stage: Literal["nominal", "nearest", "replayed", "synthesised", "answer"]
    simulator: str | None
    fit: float | None
    select: float | None
    test: float | None
    simulations: int


class ChannelError(Result):
    """Mean absolute replay error of one channel, in `unit`, on the test part (without one: on fit and select).

    scored : whether replay errors and the gain count it: its weight in robot.toml is not 0, and it moves.
    """

    channel: str
    unit: str
    nominal: float
    answer: float
    spread: float
    scored: bool = True


class Trace(Curves):
    """Measured and replayed values of one channel in one held-out episode; time [s]."""

    answer: list[float | None]


class Neighbours(Result):
    """The answer of `query`: the nearest simulators by replay error, the synthesised one, and which of them to use.

    gain : of the answer over the nominal simulator, on the test part. Like every replay error it counts the scored
    channels alone, each in units of its motion and by its weight.
    measured : the nearest other recordings in the same population, at most k, where the distance compares models.
    fits : whether the answer errs as a robot of the family would; null where that is not known: nothing was replayed,
    or misfit is above its limit and the search had not ended (true in older documents).
    misfit : error of the answer over the median of the errors that robots of the family would leave, under the same
    commands: simulated ones with noise, disturbed drives and finer time steps, and as unsteady as the recording's runs
    of the same commands. It is about 1 for a robot of the family. misfit_limit : 99 % of the robots of the family stay
    below, and it is never under 1.5; above it the alarm is raised, unless the search had not ended. Both are null where
    nothing was replayed, the limit also where too few simulators were. In documents without a limit, misfit is the
    error over the spread of the neighbours. sharpened : whether a search about the answer looked for a better one: an
    answer without it that does not fit leaves open whether another simulator of the family does. Null where nothing was
    replayed, and in older documents. cost : without these simulated robots.
    simulators : entries of the population, among which the `cost.evaluations` were made. Null in older documents.
    """

    schema_: Literal["dynreg/neighbours/1"] = Field(default="dynreg/neighbours/1", alias="schema")
    robot: str
    population: str
    recording: str
    recording_name: str
    distance: str
    k: int
    neighbours: tuple[Neighbour, ...]
    measured: tuple[MeasuredNeighbour, ...] = ()
    synthesised: Synthesised | None
    answer: str
    answer_kind: Literal["neighbour", "synthesised", "nominal"]
    answer_parameters: dict[str, float]
    nominal: Nominal
    stages: tuple[Stage, ...]
    gain: Gain | None
    parts: dict[Literal["fit", "select", "test"], tuple[str, ...]]
    channels: tuple[ChannelError, ...]
    traces: tuple[Trace, ...]
    fits: bool | None
    misfit: float | None = None
    misfit_limit: float | None = None
    sharpened: bool | None = None
    alarm: str | None
    notes: tuple[str, ...] = ()
    cost: Cost
    simulators: int | None = None

    @property
    def unclear(self) -> bool:
        """Whether held-out data do not show that the answer errs less than the nominal simulator.

        The 90 % interval of the gain reaches down to 0 or below; without an interval, the gain is 0 or less. False
        where nothing was held out, and for the nominal simulator itself.
        """
        if self.answer_kind == "nominal" or self.gain is None:
            return False
        return (self.gain.value if self.gain.low is None else self.gain.low) <= 0.0

    @property
    def unknown(self) -> str:
        """Why it is not known whether the answer errs less than the nominal simulator; "" where it is known."""
        if self.answer_kind == "nominal" or self.untested or self.unclear:
            return ""
        if self.gain is None:
            return "" if self.parts.get("test") else "nothing was held out"
        return "too few windows were held out" if self.gain.low is None else ""

    @property
    def unended(self) -> bool:
        """Whether the answer errs more than the limit allows, and a search that had not ended leaves open why."""
        return self.alarm is None and self.misfit_limit is not None and self.misfit > self.misfit_limit

    @property
    def reliable(self) -> bool:
        """Whether nothing speaks against the intervals of the synthesised simulator's parameters."""
        return self.fits is not False and not self.unended

    @property
    def far(self) -> bool:
        """Whether the answer does not fit, and no search looked for one that does."""
        return self.fits is False and self.sharpened is False

    @property
    def untested(self) -> bool:
        """Whether nothing was replayed: how close the nearest simulator is is not known."""
        return self.nominal.replay_error is None

    @property
    def reliance(self) -> str:
        """How far the intervals of the synthesised simulator's parameters can be relied on, in words."""
        if self.reliable:
            return "These intervals hold if the model is complete."
        why = (
            "the search had not ended" if self.unended else "no simulator fits, so the model is not complete"
        )
        return f"Do not rely on these intervals: {why}."

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"name": n.name, "distance": n.distance, "replay_error": n.replay_error, **n.parameters}
            for n in self.neighbours
        ]

    def plot(self, channel: str | None = None, ax: "Axes | None" = None) -> "np.ndarray":
        """Measured, nominal and the answer's curves of a held-out episode; (n,) matplotlib axes, one for a channel.

        channel : only this one, which `ax` can take. Raises UsageError where it was not drawn, and where nothing was
        replayed.
        """
        return plot_curves(self.traces, ("measured", "answer", "nominal"), channel, ax)

    def brief(self) -> str:
        many = f"{len(self.neighbours)} neighbour{'' if len(self.neighbours) == 1 else 's'}"
        known = "fits" if self.fits else "does not fit"
        fits = "not known whether it fits" if self.untested or self.unended else known
        return f"of {self.recording_name}: answer {self.answer[:12]}, {many}, {fits}"

    def __str__(self) -> str:
        gain = f": error {gain_words(self.gain, 'nominal')}" if self.gain else ""
        if self.untested:
            return f"{self.recording_name}: {self.answer[:12]} is the nearest, not known whether it is close"
        if self.far:
            return f"{self.recording_name}: {self.answer[:12]} is the best of those replayed, and not close{gain}"
        if self.fits is False:
            return f"{self.recording_name}: no simulator of this population fits. The best is {self.answer[:12]}{gain}"
        if self.unended:
            return f"{self.recording_name}: the search had not ended. The best is {self.answer[:12]}{gain}"
        if self.unclear:
            return f"{self.recording_name}: no simulator here is clearly better than nominal{gain}"
        if self.unknown:
            best = f"{self.answer[:12]} is the best, not known whether better than nominal"
            return f"{self.recording_name}: {best} ({self.unknown}){gain}"
        return f"{self.recording_name}: use the {self.answer_kind} simulator {self.answer[:12]}{gain}"
