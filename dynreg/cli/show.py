"""`dynreg show`: one stored thing."""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import stored_names


def show(
    call: Call,
    ref: Annotated[
        str,
        typer.Argument(
            metavar="ID",
            help="Hash, prefix of one, name, @last (the last recording), @answer.",
            autocompletion=stored_names,
        ),
    ],
) -> None:
    """Show one stored thing.

    It may be an entry, a recording, a population, a simulator, a robot or a result. @last is the last
    recording. @answer is the simulator that the last query recommends; diagnosed is the extended simulator of the
    last diagnosis.

    Example: dynreg show @last
    """
    with call.open() as session:
        result = session.show(ref)
        stored = session.result(result.id) if result.kind == "result" and not call.shared.json else None
    if stored is None:
        call.emit(result)
        return
    from dynreg.report.tables import render, shown_again

    with shown_again(stored):
        tables = render(stored)
    call.emit(result, tables, hint=f"dynreg report {result.id[:12]}")
