"""`dynreg export`: a part of the registry as its own, a simulator as a robot folder, a gait as commands."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import stored_names
from dynreg.errors import UsageError


class Form(StrEnum):
    """What an export is."""

    registry = "registry"
    robot = "robot"
    csv = "csv"
    mcap = "mcap"
    python = "python"
    foxglove = "foxglove"
    gif = "gif"
    png = "png"


_PLAYED = "play it, then `dynreg ingest LOG --robot ROBOT --gait @last`"


def export(
    call: Call,
    refs: Annotated[
        list[str],
        typer.Argument(
            metavar="ID...",
            help="What to export: hashes, prefixes, names or @last (the last recording).",
            autocompletion=stored_names,
        ),
    ],
    to: Annotated[Path, typer.Option(help="New directory; new file for a gait.")],
    form: Annotated[
        Form,
        typer.Option(
            "--as", help="A registry; a simulator as a robot folder; a gait as commands, as a run or drawn."
        ),
    ] = Form.registry,
) -> None:
    """Copy stored things to a new registry, or write a simulator as a robot folder.

    All that they need comes with them: a population its robot and entries, a result its recording and the
    simulators that it names. @last is the last recording; `dynreg list --kind result` has the ids of results.
    As a robot, a simulator is a robot.toml with its parameters and effects and one MJCF file for MuJoCo alone.
    As csv, mcap or python, a gait (its id, its JSON file or @last, here the last gait) is a table, a log of joint
    commands, or a Python module that needs nothing else; as gif or png it is drawn, in the simulator in which it
    walks least. As foxglove, its run there is an MCAP log of joints and pose; of a recording that was ingested with
    --gait, what was measured and what the simulator does under the same commands.

    Example: dynreg export monday --to monday-registry
    """
    if form is not Form.registry and len(refs) != 1:
        what = "simulator" if form is Form.robot else "gait"
        raise UsageError(
            f"--as {form} with {len(refs)} things", expected=f"one {what}", do="export them one by one"
        )
    with call.open() as session:
        if form not in (Form.registry, Form.robot):
            hint = None if form in (Form.gif, Form.png, Form.foxglove) else _PLAYED
            call.emit(session.export_gait(refs[0], to, form.value), f"{to}: written", hint=hint)
            return
        if form is Form.robot:
            folder = session.export_robot(refs[0], to)
            call.emit(folder, hint=f"dynreg robots check {to}")
            return
        result = session.export(refs, to)
    call.emit(result, hint=f"dynreg list --registry {to}")
