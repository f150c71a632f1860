"""`dynreg effects`: the library of causes that a diagnosis can name."""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import robot_names
from dynreg.errors import command


def effects(
    call: Call,
    robot: Annotated[
        str | None,
        typer.Argument(
            metavar="ROBOT",
            help="Packaged name or robot folder. Without one, all effects.",
            autocompletion=robot_names,
        ),
    ] = None,
    near: Annotated[
        bool, typer.Option("--near", help="Also show the experiments that separate similar effects.")
    ] = False,
) -> None:
    """List the physical effects that a diagnosis can name.

    Each has its usual sizes. A second table lists effects that no usual log separates, and the experiment that does.
    With a robot, only the effects that it can have are listed. --json prints everything.

    Example: dynreg effects servo_pendulum
    """
    from dynreg.report.tables import render
    from dynreg.session import Session

    result = Session.effects(robot)
    shown = None if call.shared.json else render(result, near=near)
    call.emit(result, shown, hint=command("trial", robot or "ROBOT", "--effect", "EFFECT"))
