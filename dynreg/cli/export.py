"""`dynreg export`: a part of the registry as a registry of its own."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, verb
from dynreg.cli.completion import stored_names


def register(app: typer.Typer) -> None:
    """Add `export` to the program."""
    verb(app, "export")(export)


def export(
    call: Call,
    refs: Annotated[
        list[str],
        typer.Argument(
            metavar="ID...",
            help="What to export: hashes, prefixes, names or @last (the last recording).",
            autocompletion=stored_names,
        ),
    ],
    to: Annotated[Path, typer.Option(help="New directory.")],
) -> None:
    """Copy stored things to a new registry.

    All that they need comes with them: a population its robot and entries, a result its recording and the
    simulators that it names. @last is the last recording; `dynreg list --kind result` has the ids of results.

    Example: dynreg export monday --to monday-registry
    """
    with call.open() as session:
        result = session.export(refs, to)
    call.emit(result, hint=f"dynreg list --registry {to}")
