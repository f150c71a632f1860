"""The room of the checks on logs."""

import re

from rich.console import Group, RenderableType

from dynreg.data.series import Finding, once
from dynreg.errors import LogError
from dynreg.report.grid import table
from dynreg.report.words import number
from dynreg.results.doctor import LogContents, LogFindings

SHOWN = 3  # names of signals in one cell


def tables(result: LogFindings) -> RenderableType:
    """What the logs hold, what was found in them, and what a drafted map lacks."""
    parts = [_contents(result.contents)] if result.contents else []
    parts += _findings(result)
    if result.drafted is not None:
        parts.append(_drafted(result))
    return Group(*parts)


def _findings(result: LogFindings) -> list[RenderableType]:
    """What is found alike in several episodes or files is one row: the first place, and how many more."""
    if not result.findings:
        return ["nothing wrong was found: the logs can be ingested"]
    first = _errors(result)[:1]  # `refusal` tells it
    rows = [(f.severity, f.check, f.where, f.told) for f in _once(result) if f not in first]
    return [table(("severity", "check", "where", "finding"), rows)] if rows else []


def _once(result: LogFindings) -> tuple[Finding, ...]:
    """What was found, once what is alike."""
    return once(Finding(**vars(f)) for f in result.findings)


def _errors(result: LogFindings) -> list[Finding]:
    return [f for f in _once(result) if f.severity == "error"]


def _contents(contents: tuple[LogContents, ...]) -> RenderableType:
    several = len({c.log for c in contents}) > 1
    rows = [
        (
            (f"{c.log} {c.topic}" if several else c.topic).strip() or c.log,
            c.type.rpartition("/")[2],
            c.messages,
            "" if c.rate is None else number(c.rate),
            "" if c.begin is None else f"{c.begin:.4g} to {c.end:.4g}",
            _signals(c),
        )
        for c in contents
    ]
    return table(("topic", "type", "messages", "Hz", "seconds", "signals"), rows)


def _signals(topic: LogContents) -> str:
    """The first signals with the units that the log states, and how many more there are; those with names first."""
    plain = [n for n in topic.signals if not re.search(r"header\.|covariance|\.[A-Z_]{4,}$", f".{n}")]
    named = [n for n in plain if re.search(r"\[[^\]]*[^\]\d]", n)] or plain
    units = {name: f" [{unit}]" for name, unit in topic.units.items()}
    first = ", ".join(f"{name}{units.get(name, '')}" for name in named[:SHOWN])
    return first + (f" and {len(named) - SHOWN} more" if len(named) > SHOWN else "")


def _drafted(result: LogFindings) -> str:
    """One line on each thing that a drafted map lacks."""
    drafted = result.drafted
    lines = [f"\nmap written to {drafted.path}: {len(drafted.found)} channels found"]
    for told, names in (
        ("missing", drafted.missing),
        ("ambiguous", drafted.ambiguous),
        ("settings not in the log", drafted.settings),
    ):
        if names:
            lines.append(f"{told}: {', '.join(names)}")
    return "\n".join(lines)


def refusal(result: LogFindings) -> LogError | None:
    """The error of logs that cannot be ingested, with the map that was drafted where there is one."""
    if result.usable:
        return None
    first, *others = _errors(result)
    problem, _, expected = first.message.partition("; expected ")  # so end the words of an error
    more = f" (and {len(others)} more)" if others else ""
    return LogError(
        (problem if first.where.split(",")[0] in problem else f"{first.where}: {problem}") + more,
        expected=expected or "a log that passes the checks",
        do=first.do or "mend the log or its map",
    )
