"""`dynreg doctor`: what is wrong with a log, before it is ingested."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import robot_names


def doctor(
    call: Call,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs to check.")],
    robot: Annotated[
        str | None, typer.Option(help="Robot whose channels they hold.", autocompletion=robot_names)
    ] = None,
    log_map: Annotated[Path | None, typer.Option("--map", help="TOML map.")] = None,
) -> None:
    """Say what is wrong with logs.

    Looks at clocks, gaps and numbers, and with a robot at its channels, units and limits. Exit status 1
    when the logs could not be ingested.

    Example: dynreg doctor run.mcap --robot servo_pendulum --map my_map.toml
    """
    from dynreg.verbs.doctor import findings

    call.emit(findings(logs, robot, log_map))
