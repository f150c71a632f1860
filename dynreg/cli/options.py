"""Arguments and options that several verbs have, each in one place: its name, its help, what a shell offers."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.completion import recording_names, robot_names

AnyRecording = Annotated[
    str,
    typer.Argument(
        metavar="RECORDING",
        help="Name, hash, @last (the last recording), or path of a log.",
        autocompletion=recording_names,
    ),
]
SomeRecordings = Annotated[
    list[str],
    typer.Argument(
        metavar="RECORDING...",
        help="Names, hashes, @last (the last recording), or paths of logs.",
        autocompletion=recording_names,
    ),
]
RobotFolder = Annotated[
    str,
    typer.Argument(metavar="ROBOT", help="Packaged name or robot folder.", autocompletion=robot_names),
]
RobotOfLog = Annotated[
    str | None,
    typer.Option(help="Robot of a log; any with a recording's channels.", autocompletion=robot_names),
]
MapOfLog = Annotated[
    Path | None,
    typer.Option("--map", help="Map of a log given by path; what is stored already is not read again."),
]
Page = Annotated[
    Path | None, typer.Option(help="Also write an HTML report to this file, in place of one that is there.")
]
