"""`dynreg list`: what the registry holds."""

from typing import Annotated

import typer

from dynreg.cli.call import Call, verb
from dynreg.cli.completion import KINDS, kinds
from dynreg.errors import UsageError


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
    if kind is not None and kind not in KINDS:
        raise UsageError(f"--kind {kind!r}", expected=f"one of {', '.join(KINDS)}", do="correct the kind")
    with call.open() as session:
        result = session.list(kind)
    call.emit(result, hint="dynreg show ID" if result.items else "dynreg populate servo_pendulum -n 1000")
