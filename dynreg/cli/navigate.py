"""`dynreg navigate`: timed commands with which a wheeled robot visits places, as a table for the robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, can_write
from dynreg.cli.options import AnyRecording, MapOfLog, Page, RobotOfLog
from dynreg.cli.output import say
from dynreg.verbs.navigate_settings import NavigateSettings

if TYPE_CHECKING:
    from dynreg.results.navigation import Navigation


def navigate(
    call: Call,
    recording: AnyRecording,
    settings: NavigateSettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Also write the commands to this file, as CSV, in place of one that is there."
        ),
    ] = None,
    report: Page = None,
) -> None:
    """Seek a plan, and write it where a file is named."""
    can_write(report, out)
    with call.open_for(robot, recording) as session, call.progress() as progress:
        found = session.navigate(recording, **vars(settings), robot=robot, log_map=log_map, progress=progress)
    if out is not None:
        _write(found, out)
    call.emit_and_write(found, report)


def _write(found: "Navigation", out: Path) -> None:
    from dynreg.verbs.written import write_out

    write_out(out, found.csv.encode())
    say(f"{out}: written")
