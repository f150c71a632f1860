"""`dynreg gait`: joint commands that walk, sought in the simulators that stand for a recording's robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, can_write
from dynreg.cli.options import AnyRecording, MapOfLog, RobotOfLog
from dynreg.cli.output import say
from dynreg.errors import PictureError, UsageError
from dynreg.verbs.gait_rounds import GaitRoundsSettings

if TYPE_CHECKING:
    from dynreg.results.gait import Gait
    from dynreg.session import Session


def gait(
    call: Call,
    recording: AnyRecording,
    settings: GaitRoundsSettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    film: Annotated[
        Path | None,
        typer.Option(help="Also draw the gait into this new file: .gif, or .png for four stills."),
    ] = None,
    trial: Annotated[
        Path | None,
        typer.Option(
            help="Try gaits on the robot: commands are written to this folder, and their logs waited for there."
        ),
    ] = None,
) -> None:
    """Seek a gait, and draw it where a film is asked for; with a folder for trials, one after the other."""
    _can_film(film)
    _can_try(trial, film, settings)
    if trial is not None:
        _try(call, recording, settings, trial, robot, log_map)
        return
    with call.open_for(robot, recording) as session:
        with call.progress() as progress:
            found = session.gait(
                recording, **vars(settings.each), robot=robot, log_map=log_map, progress=progress
            )
        call.emit(found, hint=None if found.often_falls else "dynreg export @last --as python --to gait.py")
        if film is not None:
            _film(session, found, film)


def _can_try(trial: Path | None, film: Path | None, settings: GaitRoundsSettings) -> None:
    """UsageError where trials are told about without a folder for them, or a film of them is asked for."""
    told = [
        f"--{name} {value}" for name in ("trials", "falls") if (value := getattr(settings, name)) is not None
    ]
    if trial is None and told:
        raise UsageError(
            f"{' '.join(told)} without --trial",
            expected="a folder for the trials on the robot",
            do="add --trial FOLDER",
        )
    if trial is not None and film is not None:
        raise UsageError(
            f"--film {str(film)!r} with --trial",
            expected="one of them",
            do="draw a gait of the trials with `dynreg export FOLDER/gait_1.json --as gif`",
        )


def _try(
    call: Call,
    recording: str,
    settings: GaitRoundsSettings,
    trial: Path,
    robot: str | None,
    log_map: Path | None,
) -> None:
    from dynreg.report.tables import hint

    with call.open_for(robot, recording) as session:
        with call.progress() as progress:
            told = dict(robot=robot, log_map=log_map, say=say, progress=progress)
            found = session.gait_rounds(recording, trial, **vars(settings), **told)
        call.emit(found, hint=hint(found))


def _can_film(film: Path | None) -> None:
    """UsageError before time is spent on a gait that cannot be drawn into this file."""
    from dynreg.sim.film import FORMS

    can_write(film)
    if film is not None and (film.exists() or film.suffix.lower()[1:] not in FORMS):
        raise UsageError(
            f"--film {str(film)!r}",
            expected=f"a new file whose name ends in {' or '.join('.' + form for form in FORMS)}",
            do="name another file",
        )


def _film(session: "Session", found: "Gait", film: Path) -> None:
    """Draw it; where this machine cannot, a note says so: the gait is stored all the same."""
    try:
        session.export_gait(found, film, film.suffix.lower()[1:])
    except PictureError as problem:
        say(f"note: {problem}")
    else:
        say(f"{film}: written")
