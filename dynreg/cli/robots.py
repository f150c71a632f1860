"""`dynreg robots`: the packaged robots, and the check of a robot folder."""

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


def register(app: typer.Typer) -> None:
    """Add `robots` and `robots check` to the program."""
    group = typer.Typer(rich_markup_mode=None)
    app.add_typer(group, name="robots")
    verb(group, "list")(list_robots)
    verb(group, "check")(check)
    group.callback(invoke_without_command=True)(_default)


def _default(
    ctx: typer.Context,
    registry: RegistryOption = None,
    settings_file: SettingsOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """List robots, or check a folder of your own.

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
    """Check a robot folder: its robot.toml, its model, every name in it, and whether it can be simulated.

    Example: dynreg robots check my_arm/
    """
    from dynreg.verbs.robots import robot_check

    result = robot_check(folder)
    call.emit(result, hint=f"dynreg populate {folder} -n 1000" if result.sound else None)
