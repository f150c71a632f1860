"""`dynreg compare`: models and simulators of a wheeled robot, on the last commands of a recording."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, at_least, can_write, verb
from dynreg.cli.completion import MODELS, model_names
from dynreg.cli.options import AnyRecording, MapOfLog, Page, RobotOfLog, Seed, Threads
from dynreg.errors import UsageError


def register(app: typer.Typer) -> None:
    """Add `compare` to the program."""
    verb(app, "compare")(compare)


def compare(
    call: Call,
    recording: AnyRecording,
    models: Annotated[
        str, typer.Option(metavar="A,B", help="Models to make.", autocompletion=model_names)
    ] = ",".join(MODELS),
    simulators: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            metavar="ID",
            help="A simulator, an entry, a result that recommends one, nominal, or the recording's newest diagnosis,"
            " query or calibration; may be repeated.",
        ),
    ] = None,
    starts: Annotated[int, typer.Option(help="Random starts of the networks.")] = 30,
    generations: Annotated[
        int, typer.Option(help="Generations of the search that fits the dynamic model.")
    ] = 60,
    longest: Annotated[
        float, typer.Option(help="Seconds after which a held command counts as another.")
    ] = 2.0,
    seed: Seed = None,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    threads: Threads = None,
    report: Page = None,
) -> None:
    """Compare models and simulators of a wheeled robot.

    kinematic: the closed form; dynamic: the unicycle, fitted; table: the closed form, put right in cells of wheel
    speeds; network: three small networks; mlp: one of three layers. They are made from the first 84 % of the
    recording's commands, and all are judged on the last 16 %. A simulator named by --with drives the whole recording; a
    note says if it may have seen that part. The words nominal, diagnosis, query and calibration hide nothing: what
    --with takes has ids, and no names.

    Example: dynreg compare monday --with nominal --report monday.html
    """
    can_write(report)
    at_least("--starts", starts, 1)
    at_least("--generations", generations, 1)
    at_least("--seed", seed, 0)
    at_least("--threads", threads, 0)
    if not 0 < longest < float("inf"):
        raise UsageError(f"--longest {longest:g}", expected="seconds above 0", do="give another number")
    names = [name.strip() for name in models.split(",") if name.strip()]
    unknown = [name for name in names if name not in MODELS]
    if unknown:
        raise UsageError(
            f"--models {unknown[0]!r}",
            expected=f"some of {', '.join(MODELS)}",
            do="choose from these; simulators are named by --with",
        )
    fresh_log = robot is not None and Path(recording).exists()  # it may be the first thing in a registry
    with call.open(create=fresh_log) as session, call.progress() as progress:
        result = session.compare(
            recording,
            models=names,
            simulators=simulators or (),
            seed=call.pick("seed", seed, 0),
            starts=starts,
            generations=generations,
            longest=longest,
            robot=robot,
            log_map=log_map,
            threads=call.pick("threads", threads, 0),
            progress=progress,
        )
    call.emit_and_write(result, report)
