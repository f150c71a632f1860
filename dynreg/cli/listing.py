"""`dynreg list`: what the registry holds."""

from typing import Annotated

import typer

from dynreg.cli.call import Call, one_of, verb
from dynreg.cli.completion import KINDS, kinds


def register(app: typer.Typer) -> None:
    """Add `list` to the program."""
    verb(app, "list")(list_)


def list_(
    call: Call,
    kind: Annotated[str | None, typer.Option(help="Only this kind.", autocompletion=kinds)] = None,
) -> None:
    """List what the registry holds.

    Example: dynreg list --kind recording
    """
    if kind is not None:
        one_of("--kind", kind, KINDS)
    with call.open() as session:
        result = session.list(kind)
    call.emit(result, hint="dynreg show ID" if result.items else "dynreg populate servo_pendulum -n 1000")
