"""`dynreg doctor`: what is wrong with a log, before it is ingested."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, verb
from dynreg.cli.completion import robot_names
from dynreg.errors import LogError


def register(app: typer.Typer) -> None:
    """Add `doctor` to the program."""
    verb(app, "doctor")(doctor)


def doctor(
    call: Call,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs to check.")],
    robot: Annotated[
        str | None, typer.Option(help="Robot whose channels they hold.", autocompletion=robot_names)
    ] = None,
    log_map: Annotated[Path | None, typer.Option("--map", help="TOML map.")] = None,
) -> None:
    """Say what is wrong with logs.

    Looks at clocks, gaps and numbers, and with a robot at its channels, units and limits. Exit status 1
    when the logs could not be ingested.

    Example: dynreg doctor run.mcap --robot servo_pendulum --map my_map.toml
    """
    from dynreg.cli.documents import LogFinding, LogFindings
    from dynreg.data import ingest
    from dynreg.data.maps import read_map
    from dynreg.report.tables import table
    from dynreg.sim.robot import load_robot

    spec = load_robot(robot).recording_spec if robot else None
    found = ingest.doctor(logs, spec, read_map(log_map) if log_map else None)
    findings = tuple(
        LogFinding(level=f.level, check=f.check, where=f.where, message=f.message) for f in found
    )
    wrong = [f for f in findings if f.level == "error"]
    result = LogFindings(logs=tuple(map(str, logs)), robot=robot, usable=not wrong, findings=findings)
    shown = table(
        ("level", "check", "where", "finding"), [(f.level, f.check, f.where, f.message) for f in findings]
    )
    call.emit(result, shown if findings else "nothing found: the logs can be ingested")
    if wrong:
        raise LogError(
            f"{wrong[0].where}: {wrong[0].message}"
            + (f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""),
            expected="a log that passes the checks",
            do="mend the log or its map",
        )
