"""`dynreg gait`: joint commands that walk, sought in the simulators that stand for a recording's robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, can_write
from dynreg.cli.options import AnyRecording, MapOfLog, RobotOfLog
from dynreg.cli.output import say
from dynreg.errors import PictureError, UsageError
from dynreg.verbs.gait import GaitSettings

if TYPE_CHECKING:
    from dynreg.results.gait import Gait
    from dynreg.session import Session


def gait(
    call: Call,
    recording: AnyRecording,
    settings: GaitSettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    film: Annotated[
        Path | None,
        typer.Option(help="Also draw the gait into this new file: .gif, or .png for four stills."),
    ] = None,
) -> None:
    """Seek a gait, and draw it where a film is asked for."""
    _can_film(film)
    with call.open_for(robot, recording) as session:
        with call.progress() as progress:
            found = session.gait(recording, **vars(settings), robot=robot, log_map=log_map, progress=progress)
        call.emit(found, hint=None if found.often_falls else "dynreg export @last --as python --to gait.py")
        if film is not None:
            _film(session, found, film)


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
