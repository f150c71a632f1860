"""Frozen results: what every verb answers, with a JSON form (`schemas/`) and tables for notebooks."""

import html
import json
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field


class Result(BaseModel):
    """Base of all results: frozen, strict about its fields, shown as a table in notebooks."""

    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="null", populate_by_name=True)

    def to_json(self, indent: int | None = None) -> str:
        """The JSON document of the result, as its schema says; numbers that are not finite become null."""
        return json.dumps(self.to_dict(), indent=indent)

    def to_dict(self) -> dict[str, Any]:
        """The JSON document as plain data."""
        return json.loads(self.model_dump_json(by_alias=True))

    def rows(self) -> list[dict[str, Any]]:
        """The result as a table, one dict a row."""
        return [self.to_dict()]

    def to_frame(self):
        """The rows as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(self.rows())

    def _repr_html_(self) -> str:
        table = self.to_frame().to_html(index=False, float_format="%.4g")
        said = (
            type(self).__str__ is not BaseModel.__str__
        )  # a sentence of its own, not pydantic's field by field
        return f"<p>{html.escape(str(self))}</p>{table}" if said else table


class Estimate(Result):
    """A parameter with its 90 % interval, in `unit`; the interval holds if the model is right.

    at_bound : the value lies on the edge of the population's range, so the interval says little.
    limits : that range (low, high), where there is one.
    """

    value: float
    low: float
    high: float
    unit: str
    nominal: float
    at_bound: bool = False
    limits: tuple[float, float] | None = None


class Gain(Result):
    """A relative gain with a 90 % bootstrap interval over episodes; null where there are too few."""

    value: float
    low: float | None
    high: float | None


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


class Trace(Result):
    """Measured and replayed values of one channel in one held-out episode; time [s]."""

    episode: str
    channel: str
    unit: str
    time: list[float]
    measured: list[float | None]
    nominal: list[float | None]
    answer: list[float | None]


class Cost(Result):
    """What a result cost.

    evaluations : distances evaluated; rollouts : simulators run through the fit and select parts to choose the
    answer; test_rollouts : simulators run through the test part to judge it; seconds : wall time.
    """

    evaluations: int
    rollouts: int
    test_rollouts: int = 0
    seconds: float


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


class PopulationSummary(Result):
    """A registered population and what `populate` did."""

    schema_: Literal["dynreg/population/1"] = Field(default="dynreg/population/1", alias="schema")
    population: str
    robot: str
    entries: int
    planned: int
    added: int
    seconds: float
    simulate_seconds: float = 0.0
    train_seconds: float = 0.0
    link_seconds: float = 0.0
    own_loss_median: float | None = None
    linked: int = 0
    evaluations: int = 0


class RecordingSummary(Result):
    """A registered recording."""

    schema_: Literal["dynreg/recording/1"] = Field(default="dynreg/recording/1", alias="schema")
    recording: str
    name: str
    robot: str
    measured: bool
    episodes: int
    rows_count: int
    duration: float
    rate: float | None
    channels: tuple[str, ...]
    settings: tuple[str, ...]
    findings: tuple[str, ...]


class EntrySummary(Result):
    """One entry of the registry: a simulator, a recording, a population or a result."""

    schema_: Literal["dynreg/entry/1"] = Field(default="dynreg/entry/1", alias="schema")
    id: str
    kind: Literal["entry", "recording", "population", "simulator", "result", "robot"]
    name: str
    robot: str
    detail: dict[str, Any]


class Listing(Result):
    """What a registry holds."""

    schema_: Literal["dynreg/list/1"] = Field(default="dynreg/list/1", alias="schema")
    registry: str
    items: tuple[EntrySummary, ...]

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"id": i.id[:12], "kind": i.kind, "name": i.name, "robot": i.robot, **i.detail}
            for i in self.items
        ]


class Verification(Result):
    """What `verify` found and, with repair, mended."""

    schema_: Literal["dynreg/verify/1"] = Field(default="dynreg/verify/1", alias="schema")
    registry: str
    clean: bool
    checked: dict[str, int]
    faults: tuple[str, ...]
    repaired: tuple[str, ...]
    lost: tuple[str, ...]

    def rows(self) -> list[dict[str, Any]]:
        return [{"fault": f} for f in self.faults]


class CalibrationStep(Result):
    """The best objective after so many simulations."""

    simulations: int
    error: float


class Calibration(Result):
    """Parameters fitted to a recording by a search."""

    schema_: Literal["dynreg/calibration/1"] = Field(default="dynreg/calibration/1", alias="schema")
    robot: str
    recording: str
    method: str
    simulator: str
    parameters: dict[str, Estimate]
    train_error: float
    test_error: float | None
    nominal_train_error: float
    nominal_test_error: float | None
    history: tuple[CalibrationStep, ...]
    cost: Cost

    def rows(self) -> list[dict[str, Any]]:
        return [{"parameter": name, **e.to_dict()} for name, e in self.parameters.items()]


RESULTS: tuple[type[Result], ...] = (
    Neighbours,
    PopulationSummary,
    RecordingSummary,
    EntrySummary,
    Listing,
    Verification,
    Calibration,
)
