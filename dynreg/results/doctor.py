"""The answer of `doctor`: what is wrong with logs."""

from typing import Literal

from pydantic import Field

from dynreg.results.result import Result


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
