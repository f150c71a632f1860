"""`dynreg query`: the simulators nearest to a recording."""

from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, at_least, can_write, one_of, verb
from dynreg.cli.options import AnyRecording, HoldOut, MapOfLog, Page, Population, RobotOfLog, Threads
from dynreg.distance.table import NAMES as DISTANCES
from dynreg.errors import NoMatchError

if TYPE_CHECKING:
    from dynreg.results import Neighbours


def register(app: typer.Typer) -> None:
    """Add `query` to the program."""
    verb(app, "query")(query)


def query(
    call: Call,
    recording: AnyRecording,
    k: Annotated[int | None, typer.Option("-k", help="How many neighbours [5].")] = None,
    distance: Annotated[str | None, typer.Option(help=f"One of {', '.join(DISTANCES)} [auto].")] = None,
    population: Population = None,
    replay: Annotated[bool, typer.Option(help="Replay the commands in the best and re-rank.")] = True,
    synthesise: Annotated[bool, typer.Option(help="Make a simulator from the neighbours.")] = True,
    hold_out: HoldOut = None,
    budget: Annotated[
        int | None,
        typer.Option(help="Simulations that the query may run, beyond those of --distance replay."),
    ] = None,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    threads: Threads = None,
    report: Page = None,
) -> None:
    """Find the simulators nearest to a recording.

    They are replayed with the recording's own commands and ranked again, and one answer is given. Exit
    status 4 when no simulator of the population fits the recording (the result is printed all the
    same).

    Example: dynreg query monday -k 5 --hold-out kp=400 --report monday.html
    """
    can_write(report)
    at_least("-k", k, 1)
    at_least("--budget", budget, 1)
    at_least("--threads", threads, 0)
    chosen = call.pick("distance", distance, "auto")
    one_of("--distance", chosen, DISTANCES)
    with call.open() as session, call.progress() as progress:
        result = session.query(
            recording,
            k=call.pick("k", k, 5),
            distance=chosen,
            population=population,
            replay=replay,
            synthesise=synthesise,
            hold_out=hold_out,
            budget=call.pick("budget", budget, None),
            robot=robot,
            log_map=log_map,
            threads=call.pick("threads", threads, 0),
            progress=progress,
        )
    call.emit_and_write(result, report)
    _raise_alarm(result)


def _raise_alarm(result: "Neighbours") -> None:
    if not result.fits:
        raise NoMatchError(
            f"no simulator fits {result.recording_name!r}: {result.alarm or 'its data lie outside'}",
            expected=f"a recording that population {result.population[:12]} of {result.robot} can explain",
            do="check the log with `dynreg doctor`, or populate with wider ranges",
        )
