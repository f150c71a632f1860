"""What a registry holds, and what was done to it."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


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
    """A registered recording. gait : id of the gait that was played, where the log is of its trial."""

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
    gait: str | None = None


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


class ReportFile(Result):
    """A report that was written."""

    schema_: Literal["dynreg/report/1"] = Field(default="dynreg/report/1", alias="schema")
    result: str
    path: str
    bytes: int


class Info(Result):
    """Versions, device, and what the registry holds (counts by kind, simulators of all populations)."""

    schema_: Literal["dynreg/info/1"] = Field(default="dynreg/info/1", alias="schema")
    registry: str
    holds: dict[str, int]
    entries: int
    versions: dict[str, str]
    device: str
    cores: int
