"""One self-contained HTML page of a result: no script, no font, no file besides it."""

from functools import cache
from importlib import resources
from pathlib import Path

from dynreg.errors import UsageError
from dynreg.report.tables import room
from dynreg.report.words import count, number
from dynreg.results.result import Result
from dynreg.verbs.written import write_out


def write_report(result: Result, path: str | Path) -> Path:
    """Write the page of `result` to `path`; the same result gives the same bytes.

    Raises UsageError where the result has no page or the file cannot be written.
    """
    path = Path(path)
    write_out(path, page(result).encode())
    return path


def page(result: Result) -> str:
    """The page's HTML: the template of its kind, else the usual one, filled with what its room draws.

    The result's text is made fit to be shown before, and escaped as it is filled in.
    """
    drawn = getattr(room(result), "page", None)
    if drawn is None:
        raise UsageError(
            f"a {type(result).__name__} has no report",
            expected="a stored query or calibration, a diagnosis, trials, a gait, its trials, a comparison or a drift",
            do="see `dynreg list --kind result`",
        )
    template = _environment().select_template((f"{result.schema_name()}.html", "result.html"))
    return template.render(**drawn(result.visible()))


@cache
def _environment():
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folder = Path(str(resources.files("dynreg.report") / "templates"))
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "count": count}
    return environment
