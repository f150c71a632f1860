"""`dynreg populate`: fill the registry with simulators of a robot."""

from typing import TYPE_CHECKING, Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.options import RobotFolder
from dynreg.errors import command
from dynreg.verbs.populate import PopulateSettings
from dynreg.verbs.settings import Option

if TYPE_CHECKING:
    from dynreg.registry import Registry


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
    loaded = call.robot(robot, settings.ranges)  # a mistake here makes no registry
    with call.open(create=True) as session, call.progress() as progress:
        result = session.populate(robot, n, **vars(settings), progress=progress)
        if settings.dry_run:
            session.registry.take_away()  # where this call made it
            hint = command("populate", robot, "-n", n)
        else:
            hint = _next(session.registry, robot, loaded.hash)
    call.emit(result, hint=hint)


def _next(registry: "Registry", robot: str, own: str) -> str:
    """A query of the recording of this robot (its hash) that was ingested last; an ingest where there is none."""
    infos = [info for info in registry.recordings() if own in (info.robot_hash, *info.robots)]
    if not infos:
        return command("ingest", "LOG", "--robot", robot)
    return command("query", infos[-1].name_with(own))
