"""`dynreg calibrate`: a simulator that moves like a recording, or that scores like the robot itself."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, can_write
from dynreg.cli.completion import recording_names
from dynreg.cli.options import MapOfLog, Page, RobotOfLog
from dynreg.cli.output import say
from dynreg.cli.told import naming
from dynreg.verbs.calibrate import TRYING, CalibrateSettings, answered

FLAGS = {"robot_door": "--trial", "gait": "--gait", "robot": "--robot"}


def calibrate(
    call: Call,
    recording: Annotated[
        list[str],
        typer.Argument(
            metavar="RECORDING...",
            help=f"Names, hashes, @last (the last recording), or paths of logs. For {TRYING} a robot in their place.",
            autocompletion=recording_names,
        ),
    ],
    settings: CalibrateSettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    trial: Annotated[
        Path | None,
        typer.Option(
            help=f"Folder of {TRYING}: commands of trials are written there, and their logs or scores waited for."
        ),
    ] = None,
    gait: Annotated[
        str | None,
        typer.Option(
            metavar="ID",
            help=f"With {TRYING}: stored gait to begin with.  [default: those of the robot's folder]",
        ),
    ] = None,
    report: Page = None,
) -> None:
    """Adapt a simulator."""
    can_write(report)
    given = recording if len(recording) > 1 else recording[0]
    if not settings.tries and not call.registry.is_dir():
        _require_recording(given, settings.method)
    opened = call.open(create=True) if settings.tries else call.open_for(robot, *recording)
    told = {"robot": robot, "log_map": log_map, "robot_door": trial, "gait": gait}
    told = {name: value for name, value in told.items() if value is not None}
    with naming(FLAGS), opened as session, call.progress() as progress:
        result = session.calibrate(given, **vars(settings), **told, say=say, progress=progress)
        # about no recording, so `dynreg show @last` does not lead to it
        stored = answered(session.registry, None, result.question) if settings.tries else None
    call.emit_and_write(result, report, stored and stored.id)


def _require_recording(given: str | list[str], method: str) -> None:
    """UsageError for a robot in place of a recording, where there is no registry yet that could hold one."""
    from dynreg.verbs.robot_door import require_recording

    if isinstance(given, str):
        require_recording(None, given, method)
