"""`dynreg query`: the simulators nearest to a recording."""

import typer

from dynreg.cli.call import Call, can_write, verb
from dynreg.cli.options import AnyRecording, MapOfLog, Page, RobotOfLog
from dynreg.verbs.query import QuerySettings


def register(app: typer.Typer) -> None:
    """Add `query` to the program."""
    verb(app, "query")(query)


def query(
    call: Call,
    recording: AnyRecording,
    *,
    settings: QuerySettings,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    report: Page = None,
) -> None:
    """Find the simulators nearest to a recording.

    They are replayed with the recording's own commands and ranked again, and one answer is given. Exit
    status 4 when no simulator of the population fits the recording (the result is printed all the
    same).

    Example: dynreg query monday -k 5 --hold-out kp=400 --report monday.html
    """
    can_write(report)
    with call.open() as session, call.progress() as progress:
        result = session.query(
            recording,
            **vars(settings),
            robot=robot,
            log_map=log_map,
            progress=progress,
        )
    call.emit_and_write(result, report)
