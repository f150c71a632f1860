"""Commands of verbs that take nothing special: each is made from the row of its verb."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import typer

from dynreg.cli.call import Call, can_write, verb
from dynreg.cli.options import AnyRecording, MapOfLog, Page, RobotFolder, RobotOfLog, SomeRecordings
from dynreg.session import rows
from dynreg.verbs.verb import Verb

OTHERS = "Other commands"


def register(app: typer.Typer, own: Mapping[str, Mapping[str, Callable[..., None] | None]]) -> None:
    """Add commands to the program, in this order, {heading in its help: {name: function}}.

    Functions are for what takes something special, None stands for the others. Verbs of a session that are not named
    come last.
    """
    known = rows()
    named = {name for commands in own.values() for name in commands}
    for heading, commands in {**own, OTHERS: {name: None for name in known if name not in named}}.items():
        for name, function in commands.items():
            row = known.get(name)
            verb(app, name, row and row.help, heading)(function or _ABOUT[row.about](name, row))


def _about_recording(name: str, row: Verb) -> Callable[..., None]:
    def command(
        call: Call,
        recording: SomeRecordings if row.several else AnyRecording,
        settings: row.settings,
        robot: RobotOfLog = None,
        log_map: MapOfLog = None,
        report: Page = None,
    ) -> None:
        can_write(report)
        # a log that is registered before the verb begins would stay where that fails: none is the first of a registry
        every = recording if row.several else [recording]
        opened = call.open() if row.ingest else call.open_for(robot, *every)
        advice = row.faster(settings) if row.faster else ""
        with opened as session, call.progress(advice) as progress:
            result = getattr(session, name)(
                every if len(every) > 1 else every[0],
                **vars(settings),
                robot=robot,
                log_map=log_map,
                progress=progress,
            )
        call.emit_and_write(result, report)

    return command


def _about_robot(name: str, row: Verb) -> Callable[..., None]:
    def command(call: Call, robot: RobotFolder, settings: row.settings, report: Page = None) -> None:
        ask_about_robot(call, name, robot, vars(settings), report)

    return command


def ask_about_robot(
    call: Call, name: str, robot: str, settings: Mapping[str, Any], report: Path | None
) -> None:
    """Ask a verb about a robot, in a registry that is made if need be; print the answer, and write its page."""
    can_write(report)
    loaded = call.robot(robot)  # a mistake here makes no registry
    with call.open(create=True) as session, call.progress() as progress:
        result = getattr(session, name)(loaded, **settings, progress=progress)
    call.emit_and_write(result, report)


_ABOUT = {"recording": _about_recording, "robot": _about_robot}
