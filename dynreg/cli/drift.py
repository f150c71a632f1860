"""`dynreg drift`: what changed on a robot between two recordings."""

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
            help="The earlier recording.  [default: the robot's first]",
            autocompletion=recording_names,
        ),
    ] = None,
    settings: DriftSettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="On wheels: also write the updated displacement table, as Parquet, in place of a file that is there.",
        ),
    ] = None,
    report: Page = None,
) -> None:
    """Say what changed on a robot between two recordings.

    Both recordings are diagnosed, and every parameter and cause is fitted to each of them; the values that differ
    are named. The verdict is changed, still true, or unexplained: nothing differs, and neither diagnosis explains the
    recent recording. A robot on wheels is tested in cells of wheel speeds: the answer is left wheel, right wheel, all
    speeds, turns only, still true, or too little data.

    The logs' own clocks say which recording is the earlier one, where they tell the day; else --against does. An
    option without a meaning for the robot is an error.

    Exit status 0 whatever the verdict.

    Example: dynreg drift friday --against monday --report friday.html
    """
    can_write(report, out)
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
