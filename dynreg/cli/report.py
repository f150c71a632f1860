"""`dynreg report`: a stored result as one HTML page."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call


def report(
    call: Call,
    ref: Annotated[
        str,
        typer.Argument(
            metavar="ID",
            help="Result: hash, prefix of one, @last (the last result), or a recording for its last one.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="HTML file to write, in place of one that is there.")] = Path(
        "report.html"
    ),
) -> None:
    """Write a stored result as one HTML page.

    The page needs no other file and no network. @last is the last result here; in other commands it is the last
    recording.

    Example: dynreg report @last --out monday.html
    """
    from dynreg.report.html import write_report
    from dynreg.report.tables import shown_again
    from dynreg.results.stored import ReportFile

    with call.open() as session:
        result = session.result(ref)
    with shown_again(result):
        write_report(result, out)
    written = ReportFile(result=ref, path=str(out), bytes=out.stat().st_size)
    call.emit(written, hint=f"open {out} in a browser")
