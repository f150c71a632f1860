"""`dynreg doctor`: what is wrong with a log, before it is ingested."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call, verb
from dynreg.cli.completion import robot_names
from dynreg.errors import LogError, taken_apart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynreg.data.ingest import Finding
    from dynreg.results import LogFinding


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
    from dynreg.results import LogFinding, LogFindings

    findings = tuple(LogFinding(**vars(f)) for f in _findings(logs, robot, log_map))
    wrong = [f for f in findings if f.severity == "error"]
    result = LogFindings(logs=tuple(map(str, logs)), robot=robot, usable=not wrong, findings=findings)
    call.emit(result)
    if wrong:
        raise _refused(wrong)


def _refused(wrong: "Sequence[LogFinding]") -> LogError:
    """The first error in its own words, where it says what was expected and what to do."""
    first = wrong[0]
    problem, expected, do = taken_apart(first.message)
    where = "" if first.where.split(",")[0] in problem else f"{first.where}: "
    more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
    return LogError(
        f"{where}{problem}{more}",
        expected=expected or "a log that passes the checks",
        do=do or "mend the log or its map",
    )


def _findings(logs: list[Path], robot: str | None, log_map: Path | None) -> "tuple[Finding, ...]":
    """Those without a map; where they are errors, those with the first packaged map that gives none."""
    from dynreg.data.ingest import doctor as check
    from dynreg.data.maps import read_map
    from dynreg.sim.robot import load_robot

    loaded = load_robot(robot) if robot else None
    spec = loaded.recording_spec if loaded else None
    if log_map is not None or loaded is None:
        return check(logs, spec, read_map(log_map) if log_map else None)
    first = check(logs, spec)
    if not _unusable(first):
        return first
    for path in sorted((loaded.folder / "maps").glob("*.toml")):
        found = check(logs, spec, read_map(path))
        if not _unusable(found):
            return found
    return first


def _unusable(findings: "tuple[Finding, ...]") -> bool:
    return any(f.severity == "error" for f in findings)
