"""The answer of `query`."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Cost, Curves, Estimate, Gain, Result


class Neighbour(Result):
    """One registered simulator near the recording."""

    entry: str
    name: str
    index: int
    distance: float | None
    replay_error: float | None = None
    parameters: dict[str, float]


class Synthesised(Result):
    """The simulator that the query made from the neighbours."""

    simulator: str
    replay_error: float
    parameters: dict[str, Estimate]


class Nominal(Result):
    """The robot folder's own parameter values, replayed; no error where nothing was replayed."""

    replay_error: float | None
    parameters: dict[str, float]


class Stage(Result):
    """One stage of the pipeline: errors are normalised replay errors (1 = the size of the channel's motion).

    `fit` and `select` are the parts that the query used; `test` is read once, at the end.
    """

    stage: Literal["nominal", "nearest", "replayed", "synthesised", "answer"]
    simulator: str | None
    fit: float | None
    select: float | None
    test: float | None
    simulations: int


class ChannelError(Result):
    """Mean absolute replay error of one channel on the test part (on select where there is none), in `unit`."""

    channel: str
    unit: str
    nominal: float
    answer: float
    spread: float


class Trace(Curves):
    """Measured and replayed values of one channel in one held-out episode; time [s]."""

    answer: list[float | None]


class Neighbours(Result):
    """The answer of `query`: the nearest simulators, re-ranked, the synthesised one, and which to use.

    misfit : error of the answer over what separates neighbouring simulators under the same commands (about 1 for
    a robot of the family; the alarm is raised above 3); null where nothing was replayed.
    """

    schema_: Literal["dynreg/neighbours/1"] = Field(default="dynreg/neighbours/1", alias="schema")
    robot: str
    population: str
    recording: str
    recording_name: str
    distance: str
    k: int
    neighbours: tuple[Neighbour, ...]
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
    fits: bool
    misfit: float | None = None
    alarm: str | None
    notes: tuple[str, ...] = ()
    cost: Cost

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"name": n.name, "distance": n.distance, "replay_error": n.replay_error, **n.parameters}
            for n in self.neighbours
        ]

    def __str__(self) -> str:
        gain = f", error {self.gain.value:.0%} below nominal" if self.gain else ""
        if self.gain and self.gain.low is not None and self.gain.high is not None:
            gain += f" (90% interval {self.gain.low:.0%} to {self.gain.high:.0%})"
        return f"{self.recording_name}: use {self.answer_kind} simulator {self.answer[:12]}{gain}"
