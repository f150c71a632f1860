"""`dynreg populate`: fill the registry with simulators of a robot."""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.options import RobotFolder
from dynreg.errors import command
from dynreg.verbs.populate import PopulateSettings, check_count
from dynreg.verbs.settings import Option, flags


def populate(
    call: Call,
    robot: RobotFolder,
    n: Annotated[int, typer.Option("-n", help="Number of simulators in the population.")],
    settings: PopulateSettings,
) -> None:
    """Fill the registry with N simulators of a robot.

    Each simulator gets parameters of its own, is simulated, and gets a learned model of its dynamics. Run the command
    again to grow a population or to finish an interrupted one.

    Example: dynreg populate servo_pendulum -n 1000
    """
    Option("A number.", least=1).check("-n", n)
    check_count(n)
    call.robot(robot, settings.ranges)  # a mistake here makes no registry
    with call.open(create=True) as session, call.progress() as progress:
        result = session.populate(robot, n, **vars(settings), progress=progress)
        if settings.dry_run:
            session.registry.take_away()  # where this call made it
    if settings.dry_run:
        hint = command("populate", robot, "-n", n, *flags(settings, without=("dry_run",)))
    elif settings.effects:
        hint = command("query", result.recording, "--population", result.population[:12])
    elif result.recording:
        hint = command("query", result.recording)
    else:
        hint = command("ingest", "LOG", "--robot", robot)
    call.emit(result, hint=hint)
