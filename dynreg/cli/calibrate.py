"""`dynreg calibrate`: fit the parameters to a recording by a search, for comparison."""

from typing import Annotated

import typer

from dynreg.cli.call import Call, verb
from dynreg.cli.completion import recording_names
from dynreg.verbs.calibrate import CalibrateSettings


def register(app: typer.Typer) -> None:
    """Add `calibrate` to the program."""
    verb(app, "calibrate")(calibrate)


def calibrate(
    call: Call,
    recording: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING",
            help="Name, hash or @last (the last recording).",
            autocompletion=recording_names,
        ),
    ],
    settings: CalibrateSettings,
) -> None:
    """Fit a robot's parameters by a search.

    The reference that a query is compared with: it needs no population. It begins with the robot's own
    values, and never ends with worse ones.

    Example: dynreg calibrate monday --method cma --hold-out kp=400
    """
    with call.open() as session, call.progress() as progress:
        result = session.calibrate(recording, **vars(settings), progress=progress)
    call.emit(result, hint="dynreg report @last")
