"""Arguments and options that several verbs have, each in one place: its name, its help, what a shell offers."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.completion import recording_names, robot_names, stored_names

AnyRecording = Annotated[
    str,
    typer.Argument(
        metavar="RECORDING",
        help="Name, hash, @last (the last recording), or path of a log.",
        autocompletion=recording_names,
    ),
]
RobotFolder = Annotated[
    str,
    typer.Argument(metavar="ROBOT", help="Packaged name or robot folder.", autocompletion=robot_names),
]
RobotOfLog = Annotated[
    str | None, typer.Option(help="Robot of a log given by path.", autocompletion=robot_names)
]
MapOfLog = Annotated[Path | None, typer.Option("--map", help="Map of a log given by path.")]
HoldOut = Annotated[
    str | None,
    typer.Option(help="Test part: a setting (kp=400), episodes (a,b) or a share (0.25)."),
]
Population = Annotated[
    str | None,
    typer.Option(help="Population to choose from [the only one].", autocompletion=stored_names),
]
Seed = Annotated[int | None, typer.Option(help="Seed [0].")]
Threads = Annotated[int | None, typer.Option(help="Simulation threads [all cores].")]
ThresholdRuns = Annotated[
    int, typer.Option(help="Simulations without an effect that set the threshold; 0 for the usual one.")
]
Page = Annotated[Path | None, typer.Option(help="Write an HTML report as well.")]
