"""JSON documents of the verbs that answer with something else than a registered result."""

from typing import Literal

from pydantic import Field

from dynreg.results import RESULTS, Result


class RobotLine(Result):
    """A packaged robot."""

    name: str
    title: str
    engines: tuple[str, ...]
    control_rate: float | None
    channels: tuple[str, ...]
    actions: tuple[str, ...]
    settings: tuple[str, ...]
    parameters: tuple[str, ...]


class RobotList(Result):
    """The robots that come with dynreg."""

    schema_: Literal["dynreg/robots/1"] = Field(default="dynreg/robots/1", alias="schema")
    robots: tuple[RobotLine, ...]


class RobotCheck(Result):
    """What is wrong with a robot folder; nothing where it can be simulated."""

    schema_: Literal["dynreg/robot_check/1"] = Field(default="dynreg/robot_check/1", alias="schema")
    robot: str
    sound: bool
    problems: tuple[str, ...]


class LogFinding(Result):
    """One finding of a check on a log."""

    severity: Literal["error", "warning", "info"]
    check: str
    where: str
    message: str


class LogFindings(Result):
    """What the checks found in logs; `usable` when nothing of it keeps them from being ingested."""

    schema_: Literal["dynreg/doctor/1"] = Field(default="dynreg/doctor/1", alias="schema")
    logs: tuple[str, ...]
    robot: str | None
    usable: bool
    findings: tuple[LogFinding, ...]


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


DOCUMENTS: tuple[type[Result], ...] = (*RESULTS, RobotList, RobotCheck, LogFindings, ReportFile, Info)
