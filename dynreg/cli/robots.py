"""`dynreg robots`: the packaged robots, the check of a robot folder, a copy of one, a folder drafted from a model."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import (
    Call,
    DebugOption,
    JsonOption,
    QuietOption,
    RegistryOption,
    SettingsOption,
    Shared,
    call_of,
    verb,
)
from dynreg.cli.completion import robot_names
from dynreg.cli.help import GroupHelp
from dynreg.cli.options import RobotFolder
from dynreg.errors import command
from dynreg.verbs.robot_draft import RobotDraftSettings


def register(app: typer.Typer, panel: str) -> None:
    """Add `robots` and its commands to the program, under a heading of its help."""
    group = typer.Typer(rich_markup_mode=None, cls=GroupHelp)
    app.add_typer(group, name="robots", rich_help_panel=panel)
    verb(group, "list")(list_robots)
    verb(group, "check")(check)
    verb(group, "copy")(copy)
    verb(group, "init")(init)
    group.callback(invoke_without_command=True)(_default)


def _default(
    ctx: typer.Context,
    registry: RegistryOption = None,
    settings_file: SettingsOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """List robots; draft, copy or check a folder of your own.

    Example: dynreg robots check my_arm/
    """
    ctx.obj = Shared(registry, settings_file, json, quiet, debug).over(ctx.obj or Shared())
    if ctx.invoked_subcommand is None:
        list_robots(call_of(ctx.obj))


def list_robots(call: Call) -> None:
    """List the robots that come with dynreg.

    Example: dynreg robots list
    """
    from dynreg.verbs.robots import robot_list

    call.emit(robot_list(), hint="dynreg populate ROBOT -n 1000")


def check(
    call: Call,
    folder: Annotated[
        str,
        typer.Argument(metavar="FOLDER", help="Robot folder or packaged name.", autocompletion=robot_names),
    ],
) -> None:
    """Check a robot folder.

    The check reads robot.toml and the model, resolves every name, and simulates a little.
    It prints all errors and warnings, each with its line in robot.toml.

    Exit status 1: there are errors, and the folder cannot be used. Warnings alone exit with 0.

    Example: dynreg robots check my_arm/
    """
    from dynreg.verbs.robots import robot_check

    result = robot_check(folder)
    call.emit(result, hint=_use(folder) if result.sound else None)


def _use(folder: str) -> str:
    """What to do with a sound robot: with one of a user's own, to bring in a log."""
    own = Path(folder).is_dir()
    return command("ingest", "LOG", "--robot", folder) if own else command("populate", folder, "-n", 1000)


def copy(
    call: Call,
    robot: RobotFolder,
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="New folder; the robot gets its name.")],
) -> None:
    """Copy a robot to a new folder, to change it.

    The copy is checked as by `robots check`.

    Example: dynreg robots copy servo_pendulum my_servo
    """
    from dynreg.verbs.robots import robot_copy

    result = robot_copy(robot, folder)
    call.emit(result, hint=_use(str(folder)) if result.sound else None)


def init(
    call: Call,
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="MJCF or URDF file of the robot.")],
    settings: RobotDraftSettings,
    log: Annotated[
        Path | None, typer.Option(help="A log of the robot: rate, noise and a map are taken from it.")
    ] = None,
) -> None:
    """Draft a robot folder from an MJCF or URDF file.

    The folder holds the model, robot.toml and, with --log, a map of the log. Drives, limits and parameters come from
    the model. Comments in robot.toml say what was guessed or left out.

    Example: dynreg robots init go2.xml --log run.parquet --drive position --kp 20 --kd 1.5
    """
    from dynreg.verbs.robot_draft import robot_draft

    with call.progress() as progress:
        result = robot_draft(model, log, settings, progress)
    call.emit(result, hint=command("robots", "check", result.folder))
