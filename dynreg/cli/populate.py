"""`dynreg populate`: fill the registry with simulators of a robot."""

from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.options import RobotFolder
from dynreg.verbs.populate import PopulateSettings
from dynreg.verbs.settings import Option


def populate(
    call: Call,
    robot: RobotFolder,
    n: Annotated[int, typer.Option("-n", help="Simulators that the population shall hold.")],
    settings: PopulateSettings,
) -> None:
    """Fill the registry with N simulators of a robot.

    Each one is simulated with parameters of its own, and a model of its dynamics is trained. Runs again
    to grow a population or to finish one that was interrupted.

    Example: dynreg populate servo_pendulum -n 1000
    """
    from dynreg.sim.robot import load_robot

    Option("A number.", least=1).check("-n", n)
    load_robot(robot, settings.ranges)  # a mistake here makes no registry
    with call.open(create=True) as session, call.progress() as progress:
        result = session.populate(robot, n, **vars(settings), progress=progress)
    call.emit(result, hint=f"dynreg ingest LOG --robot {robot}")
