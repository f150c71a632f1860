"""`dynreg list`: what the registry holds."""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import KINDS, one_of
from dynreg.verbs.settings import Option


def list_(
    call: Call,
    kind: Annotated[
        str | None,
        typer.Option(help="Show only this kind.", metavar="|".join(KINDS), autocompletion=one_of(KINDS)),
    ] = None,
) -> None:
    """List what the registry holds.

    Recordings and results stand in the order in which they came, the newest last. Others are sorted by name, robots
    then by version.

    Example: dynreg list --kind recording
    """
    Option("A kind.", choices=KINDS).check("--kind", kind)
    with call.open() as session:
        result = session.list(kind)
    call.emit(result, hint="dynreg show ID" if result.items else "dynreg populate servo_pendulum -n 1000")
