"""`dynreg robots`: the packaged robots, and the check of a robot folder."""

from typing import TYPE_CHECKING, Annotated

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
from dynreg.errors import RobotError, taken_apart

if TYPE_CHECKING:
    from dynreg.results import RobotLine


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
    from dynreg.results import RobotList
    from dynreg.sim.robot import packaged_robots

    result = RobotList(robots=tuple(_line(name) for name in packaged_robots()))
    call.emit(result, hint="dynreg populate ROBOT -n 1000")


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
    from dynreg.results import RobotCheck
    from dynreg.sim.check import check_robot

    problems = tuple(check_robot(folder))
    result = RobotCheck(robot=folder, sound=not problems, problems=problems)
    hint = None if problems else f"dynreg populate {folder} -n 1000"
    call.emit(result, hint=hint)
    if problems:
        raise _refused(folder, problems)


def _refused(folder: str, problems: tuple[str, ...]) -> RobotError:
    """The first problem in its own words, where it says what was expected and what to do."""
    problem, expected, do = taken_apart(problems[0])
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return RobotError(
        f"{folder!r} cannot be used: {problem}{more}",
        expected=expected or "a robot folder that can be simulated",
        do=do or "mend its robot.toml or model",
    )


def _line(name: str) -> "RobotLine":
    from dynreg.results import RobotLine
    from dynreg.sim.robot import load_robot

    robot = load_robot(name)
    head = robot.file.robot
    return RobotLine(
        name=robot.name,
        title=head.title or "",
        engines=tuple(head.engines),
        control_rate=head.control_rate,
        channels=robot.channels,
        actions=robot.actions,
        settings=robot.settings,
        parameters=tuple(p.name for p in robot.space.parameters),
    )
