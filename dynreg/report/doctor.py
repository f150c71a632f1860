"""The room of the checks on logs."""

from rich.console import RenderableType

from dynreg.errors import LogError
from dynreg.report.grid import table
from dynreg.report.words import first_of
from dynreg.results.doctor import LogFindings


def tables(result: LogFindings) -> RenderableType:
    """The findings; what is found alike in several episodes or files is one row: the first place, and how many more."""
    if not result.findings:
        return "nothing found: the logs can be ingested"
    places: dict[tuple[str, str, str], list[str]] = {}
    for f in result.findings:
        places.setdefault((f.severity, f.check, f.message), []).append(f.where)
    more = {key: f" (and {len(where) - 1} more such places)" for key, where in places.items() if where[1:]}
    rows = [(key[0], key[1], where[0] + more.get(key, ""), key[2]) for key, where in places.items()]
    return table(("severity", "check", "where", "finding"), rows)


def refusal(result: LogFindings) -> LogError | None:
    """The error of logs that could not be ingested."""
    if result.usable:
        return None
    wrong = [f for f in result.findings if f.severity == "error"]
    problem, expected, do = first_of([f.message for f in wrong])
    where = wrong[0].where
    return LogError(
        problem if where.split(",")[0] in problem else f"{where}: {problem}",
        expected=expected or "a log that passes the checks",
        do=do or "mend the log or its map",
    )
