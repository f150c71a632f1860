"""What a registry holds, and what was done to it."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


class Expected(Result):
    """What it would cost to populate what is missing, by `made` simulators that were timed and thrown away.

    seconds : by step, on so many cores. disk_bytes : of what would be written; free_bytes : of the registry's disk,
    None of a shared one. bucket : where the files of a shared one go. memory_bytes : the most at once.
    """

    made: int
    missing: int
    seconds: dict[str, float]
    disk_bytes: int
    free_bytes: int | None
    bucket: str | None = None
    memory_bytes: int
    cores: int


class PopulationSummary(Result):
    """A registered population and what `populate` did; expected : what it would do, of a dry run.

    recording : what the recording of this robot is called that was ingested last; null where there is none.
    """

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
    recording: str | None = None
    expected: Expected | None = None


class RecordingSummary(Result):
    """A registered recording.

    gait : id of the gait that was played, where the log is of its trial. version : of the robot with which it was
    ingested last. simulators : how many of that version are registered. notes : what ingesting it changed of what was
    there.
    """

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
    version: int | None = None
    simulators: int | None = None
    notes: tuple[str, ...] = ()


class EntrySummary(Result):
    """One entry of the registry: a simulator, a recording, a population or a result."""

    schema_: Literal["dynreg/entry/1"] = Field(default="dynreg/entry/1", alias="schema")
    id: str
    kind: Literal["entry", "recording", "measured", "population", "simulator", "result", "robot"]
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


class Removal(Result):
    """What `rm` took out of a registry, or would: what was asked for first, then what cannot be used without it.

    removed : whether it was done. items : each with a detail "needs" where it was not asked for. moved : recordings
    that are used with another version of their robot from then on, a line each. bytes : of the files that go.
    """

    schema_: Literal["dynreg/removal/1"] = Field(default="dynreg/removal/1", alias="schema")
    registry: str
    removed: bool
    items: tuple[EntrySummary, ...]
    moved: tuple[str, ...]
    bytes: int

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"id": i.id[:12], "kind": i.kind, "name": i.name, "robot": i.robot, **i.detail}
            for i in self.items
        ]


class Import(Result):
    """What `import` brought from another registry.

    added, known : {kind: how many} of its things that are new here, and that were here before. left_out : what was not
    taken, and why. damaged : how many things were left out because they cannot be read in the other registry.
    """

    schema_: Literal["dynreg/import/1"] = Field(default="dynreg/import/1", alias="schema")
    registry: str
    source: str
    added: dict[str, int]
    known: dict[str, int]
    left_out: tuple[str, ...]
    damaged: int = 0

    def rows(self) -> list[dict[str, Any]]:
        return [{"kind": kind, "added": self.added[kind], "known": self.known[kind]} for kind in self.added]


class CollectedFile(Result):
    """A file or folder that need not be kept: its path in the registry, else from the root, why, and its bytes."""

    path: str
    why: str
    bytes: int


class Collection(Result):
    """What `gc` removed, or would. removed : whether it was done."""

    schema_: Literal["dynreg/collection/1"] = Field(default="dynreg/collection/1", alias="schema")
    registry: str
    removed: bool
    files: tuple[CollectedFile, ...]
    bytes: int

    def rows(self) -> list[dict[str, Any]]:
        return [{"path": f.path, "why": f.why, "bytes": f.bytes} for f in self.files]


class ReportFile(Result):
    """A report that was written."""

    schema_: Literal["dynreg/report/1"] = Field(default="dynreg/report/1", alias="schema")
    result: str
    path: str
    bytes: int


class DatasetExport(Result):
    """A dataset that was written for other projects.

    form : its format. episodes : null where it holds models. transitions : those in which everything was measured; null
    where it holds models. models : null where it holds rows. bytes : of all its files, the card included.
    """

    schema_: Literal["dynreg/dataset_export/1"] = Field(default="dynreg/dataset_export/1", alias="schema")
    place: str
    form: str
    robot: str
    entries: int
    recordings: int
    episodes: int | None = None
    transitions: int | None = None
    models: int | None = None
    bytes: int


class Info(Result):
    """Versions, machine, and what the registry holds (counts by kind, simulators of all populations).

    exists : whether a registry is at that path. optional : {package: version}, null where it is not installed.
    device : name of the GPU, or "cpu". catalog, blobs : addresses of a shared registry, "" of one in its own folder.
    """

    schema_: Literal["dynreg/info/1"] = Field(default="dynreg/info/1", alias="schema")
    registry: str
    exists: bool = True
    holds: dict[str, int]
    entries: int
    catalog: str = ""
    blobs: str = ""
    versions: dict[str, str]
    optional: dict[str, str | None] = {}
    system: str = ""
    device: str
    cores: int
