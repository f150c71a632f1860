"""`dynreg drift`: whether a registered recording is still true of a wheeled robot."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, can_write
from dynreg.cli.completion import recording_names
from dynreg.cli.options import AnyRecording, MapOfLog, Page, RobotOfLog
from dynreg.cli.output import say
from dynreg.verbs.drift import DriftSettings


def drift(
    call: Call,
    recording: AnyRecording,
    *,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="EARLIER",
            help="The recording that may be out of date [the robot's first].",
            autocompletion=recording_names,
        ),
    ] = None,
    settings: DriftSettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the updated displacement table, too: a Parquet file."),
    ] = None,
    report: Page = None,
) -> None:
    """Test whether a wheeled robot still moves as an earlier recording says.

    Displacements are compared cell by cell of wheel speeds; what moved is named: left wheel, right wheel, all
    speeds, turns only. It exits 0 whatever the verdict: still true, moved, too little data.

    Example: dynreg drift friday --against monday --report friday.html
    """
    can_write(report)
    can_write(out)
    with call.open_for(robot, recording, against) as session, call.progress() as progress:
        result = session.drift(
            recording,
            against,
            **vars(settings),
            out=out,
            robot=robot,
            log_map=log_map,
            progress=progress,
        )
    if out is not None:
        say(f"{out}: written")
    call.emit_and_write(result, report)
