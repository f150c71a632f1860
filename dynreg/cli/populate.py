"""`dynreg populate`: fill the registry with simulators of a robot."""

from typing import Annotated

import typer

from dynreg.cli.call import Call, at_least, verb
from dynreg.cli.completion import robot_names
from dynreg.cli.options import Threads


def register(app: typer.Typer) -> None:
    """Add `populate` to the program."""
    verb(app, "populate")(populate)


def populate(
    call: Call,
    robot: Annotated[
        str,
        typer.Argument(metavar="ROBOT", help="Packaged robot or robot folder.", autocompletion=robot_names),
    ],
    n: Annotated[int, typer.Option("-n", help="Simulators that the population shall hold.")],
    seed: Annotated[int | None, typer.Option(help="Seed of all random draws [0].")] = None,
    ranges: Annotated[str | None, typer.Option(help="Named ranges of robot.toml.")] = None,
    link: Annotated[bool, typer.Option(help="Build the search graph as well.")] = True,
    threads: Threads = None,
) -> None:
    """Fill the registry with N simulators of a robot.

    Each one is simulated with parameters of its own, and a model of its dynamics is trained. Runs again
    to grow a population or to finish one that was interrupted.

    Example: dynreg populate servo_pendulum -n 1000
    """
    from dynreg.sim.robot import load_robot

    at_least("-n", n, 1)
    at_least("--seed", seed, 0)
    at_least("--threads", threads, 0)
    load_robot(robot, ranges)  # a mistake here makes no registry
    with call.open(create=True) as session, call.progress() as progress:
        result = session.populate(
            robot,
            n,
            seed=call.pick("seed", seed, 0),
            ranges=ranges,
            link=link,
            threads=call.pick("threads", threads, 0),
            progress=progress,
        )
    call.emit(result, hint=f"dynreg ingest LOG --robot {robot}")
