"""`dynreg doctor`: what a log holds and what is wrong with it, before it is ingested; a map drafted from it."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import robot_names
from dynreg.errors import command


def doctor(
    call: Call,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs to check.")],
    robot: Annotated[
        str | None, typer.Option(help="Robot whose channels they hold.", autocompletion=robot_names)
    ] = None,
    log_map: Annotated[Path | None, typer.Option("--map", help="TOML map.")] = None,
    draft_map: Annotated[
        Path | None,
        typer.Option("--draft-map", metavar="FILE", help="Draft a map and write it; - for stdout."),
    ] = None,
) -> None:
    """Say what is in logs, and what is wrong with them.

    It lists topics with their types, rates and units, and checks clocks, gaps and numbers. With a robot it also
    checks the robot's channels, units and limits. `--draft-map` writes a map to start from.

    Exit status 1: the logs cannot be ingested, by the drafted map where one was drafted.

    Example: dynreg doctor run.mcap --robot servo_pendulum --draft-map my_map.toml
    """
    from dynreg.errors import UsageError
    from dynreg.report.doctor import refusal
    from dynreg.verbs.doctor import findings

    if log_map is not None and draft_map is not None:
        raise UsageError(
            f"--map {log_map} with --draft-map {draft_map}", expected="one of the two", do="leave one out"
        )
    answer = findings(logs, robot, log_map, draft_map)
    if answer.drafted is not None and answer.drafted.path is None and not call.shared.json:
        typer.echo(answer.drafted.text, nl=False)
        if (problem := refusal(answer)) is not None:
            raise problem
        return
    call.emit(answer, hint=_next(answer, logs))


def _next(answer, logs: list[Path]) -> str | None:
    """The next step where a map was drafted with which the logs can be read."""
    if answer.drafted is None or not answer.usable:
        return None
    if answer.robot is None:
        if any(f.check == "clock" and f.severity == "warning" for f in answer.findings):
            return None  # it drafts from a clock that nobody doubts
        return command("robots", "init", "MODEL.xml", "--log", logs[0])
    return command("ingest", *logs, "--robot", answer.robot, "--map", answer.drafted.path)
