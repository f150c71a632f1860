"""`dynreg effects`: the library of causes that a diagnosis can name."""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import robot_names


def effects(
    call: Call,
    robot: Annotated[
        str | None,
        typer.Argument(
            metavar="ROBOT", help="Packaged name or robot folder [none].", autocompletion=robot_names
        ),
    ] = None,
    near: Annotated[bool, typer.Option("--near", help="Also what tells those apart that are near.")] = False,
) -> None:
    """List the physical effects that a diagnosis can name.

    With their usual sizes, those that no usual log tells apart, and the experiment that does. With a robot:
    those that it can have. --json has it all.

    Example: dynreg effects servo_pendulum
    """
    from dynreg.report.tables import render
    from dynreg.session import Session

    result = Session.effects(robot)
    shown = None if call.shared.json else render(result, near=near)
    call.emit(result, shown, hint=f"dynreg trial {robot or 'ROBOT'} --effect EFFECT")
