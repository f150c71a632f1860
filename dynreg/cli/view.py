"""`dynreg view`: MuJoCo's viewer with a recording and a simulator in it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import recording_names
from dynreg.errors import UsageError
from dynreg.verbs.simulator import NAMES

if TYPE_CHECKING:
    from dynreg.watch.frames import Frames


def view(
    call: Call,
    ref: Annotated[
        str,
        typer.Argument(
            metavar="ID",
            help="Recording, result or gait (id, name or @last, the last recording); or a robot.",
            autocompletion=recording_names,
        ),
    ],
    simulator: Annotated[
        str | None,
        typer.Option(
            "--with",
            metavar="ID",
            help=f"Simulator beside the recording, an id or one of {', '.join(NAMES)}."
            "  [default: what the result recommends, else nominal]",
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(help="Close the window after so many seconds.  [default: when you close it]"),
    ] = None,
) -> None:
    """Play a recording beside a simulator in MuJoCo's viewer.

    The simulated robot is solid, the measured one pale. The simulator gets the recorded commands, and restarts from
    the measured state at each window. The viewer needs a display; without one, use `dynreg export`.

    Example: dynreg view monday --with @answer
    """
    from dynreg.watch.window import require_display, require_seconds, show

    require_seconds(seconds)
    require_display()
    show(_frames(call, ref, simulator), seconds)


def _frames(call: Call, ref: str, simulator: str | None) -> "Frames":
    """Of a stored thing; else of a robot, by its packaged name or folder."""
    from dynreg.sim.robot import load_robot, packaged_robots
    from dynreg.watch.frames import still

    if ref in packaged_robots() or (Path(ref) / "robot.toml").is_file():
        if simulator is not None:
            raise UsageError(
                f"--with {simulator} beside robot {ref!r}",
                expected="a recording, or a result about one: a robot is shown alone, at rest",
                do="leave --with out, or name a recording",
            )
        return still(load_robot(ref))
    with call.open() as session:
        return session.frames(ref, simulator)
