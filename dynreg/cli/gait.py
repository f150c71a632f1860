"""`dynreg gait`: joint commands that walk, sought in the simulators that stand for a recording's robot."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, at_least, can_write, one_of, verb
from dynreg.cli.options import AnyRecording, MapOfLog, Population, RobotOfLog, Seed, Threads
from dynreg.errors import PictureError, UsageError
from dynreg.gait.methods import ACCEPT, METHODS
from dynreg.verbs.gait import OF_POPULATION, SOURCES

if TYPE_CHECKING:
    from dynreg.results import Gait
    from dynreg.session import Session


def register(app: typer.Typer) -> None:
    """Add `gait` to the program."""
    verb(app, "gait")(gait)


def gait(
    call: Call,
    recording: AnyRecording,
    k: Annotated[int | None, typer.Option("-k", help="Simulators that the gait must walk in [5].")] = None,
    on: Annotated[
        str,
        typer.Option(help=f"Simulators: {', '.join(SOURCES)}, or their ids with commas between them."),
    ] = SOURCES[0],
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = METHODS[0],
    accept: Annotated[
        str | None,
        typer.Option(
            help=f"What the search raises over the simulators: {', '.join(ACCEPT)}"
            f" [{ACCEPT[0]}; of a population the {OF_POPULATION}]."
        ),
    ] = None,
    task: Annotated[str | None, typer.Option(help="One of the robot's [[tasks]] [its first].")] = None,
    rollouts: Annotated[int, typer.Option(help="Runs of one simulator that the search may cost.")] = 750,
    patience: Annotated[
        int | None, typer.Option(help="Give up after so many gaits without a better one [never].")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted search.")] = False,
    seed: Seed = None,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    population: Population = None,
    threads: Threads = None,
    film: Annotated[
        Path | None,
        typer.Option(help="Draw the gait, too, into this new file: .gif, or .png for four stills."),
    ] = None,
) -> None:
    """Seek a gait that walks in the simulators nearest to a recording.

    The gait is stored; a search that was interrupted goes on where it was with --resume.

    Example: dynreg gait monday -k 5 --rollouts 2500
    """
    one_of("--method", method, METHODS)
    if accept is not None:
        one_of("--accept", accept, ACCEPT)
    for flag, value in (("-k", k), ("--rollouts", rollouts), ("--patience", patience)):
        at_least(flag, value, 1)
    at_least("--seed", seed, 0)
    at_least("--threads", threads, 0)
    _can_film(film)
    with call.open(create=robot is not None) as session:
        with call.progress() as progress:
            found = session.gait(
                recording,
                k=call.pick("k", k, 5),
                on=on,
                method=method,
                accept=accept,
                task=task,
                rollouts=rollouts,
                patience=patience,
                resume=resume,
                seed=call.pick("seed", seed, 0),
                robot=robot,
                log_map=log_map,
                population=population,
                threads=call.pick("threads", threads, 0),
                progress=progress,
            )
        call.emit(found, hint="dynreg export @last --as python --to gait.py")
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
        print(f"note: {problem}", file=sys.stderr, flush=True)
    else:
        print(f"{film}: written", file=sys.stderr, flush=True)
