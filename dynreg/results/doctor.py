"""The answer of `doctor`: what is wrong with logs."""

from typing import Literal

from pydantic import Field

from dynreg.results.result import Result


class LogFinding(Result):
    """One finding of a check on a log. do : what to do about it; "" where there is nothing."""

    severity: Literal["error", "warning", "info"]
    check: str
    where: str
    message: str
    do: str = ""


class LogContents(Result):
    """One topic of a log, or a table as a whole (`topic` is "" then).

    `messages` counts messages or rows; `rate` [Hz] is that of the median step; `begin` and `end` are [s] since the
    log's first stamp; `signals` are named without the topic; `units` are those that the log states.
    """

    log: str
    topic: str
    type: str
    messages: int
    rate: float | None
    begin: float | None
    end: float | None
    signals: tuple[str, ...]
    units: dict[str, str]


class DraftedMap(Result):
    """A map drafted from the log: its text, and the channels and settings for which the log holds nothing."""

    text: str
    path: str | None
    found: tuple[str, ...]
    missing: tuple[str, ...]
    ambiguous: tuple[str, ...]
    settings: tuple[str, ...]


class LogFindings(Result):
    """What the checks found in logs; `usable` when nothing of it keeps them from being ingested.

    `contents` : what the logs hold, where no robot was named or a map was asked for.
    """

    schema_: Literal["dynreg/doctor/1"] = Field(default="dynreg/doctor/1", alias="schema")
    logs: tuple[str, ...]
    robot: str | None
    usable: bool
    findings: tuple[LogFinding, ...]
    contents: tuple[LogContents, ...] = ()
    drafted: DraftedMap | None = None
