"""`dynreg calibrate`: fit the parameters to a recording by a search, for comparison."""

from typing import Annotated

import typer

from dynreg.adapt.methods import METHODS
from dynreg.cli.call import Call, at_least, one_of, verb
from dynreg.cli.completion import methods, recording_names
from dynreg.cli.options import HoldOut, Threads


def register(app: typer.Typer) -> None:
    """Add `calibrate` to the program."""
    verb(app, "calibrate")(calibrate)


def calibrate(
    call: Call,
    recording: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING",
            help="Name, hash or @last (the last recording).",
            autocompletion=recording_names,
        ),
    ],
    method: Annotated[
        str, typer.Option(help=f"One of {', '.join(METHODS)}.", autocompletion=methods)
    ] = METHODS[0],
    seed: Annotated[int | None, typer.Option(help="Seed of the search [0].")] = None,
    budget: Annotated[int, typer.Option(help="Simulations that the search may run.")] = 600,
    hold_out: HoldOut = None,
    threads: Threads = None,
) -> None:
    """Fit a robot's parameters by a search.

    The reference that a query is compared with: it needs no population.

    Example: dynreg calibrate monday --method cmaes --hold-out kp=400
    """
    one_of("--method", method, METHODS)
    at_least("--budget", budget, 1)
    at_least("--seed", seed, 0)
    at_least("--threads", threads, 0)
    with call.open() as session, call.progress() as progress:
        result = session.calibrate(
            recording,
            method=method,
            seed=call.pick("seed", seed, 0),
            budget=budget,
            hold_out=hold_out,
            threads=call.pick("threads", threads, 0),
            progress=progress,
        )
    call.emit(result, hint="dynreg report @last")
