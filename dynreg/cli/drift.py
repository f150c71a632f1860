"""`dynreg drift`: whether a registered recording is still true of a wheeled robot."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, at_least, can_write, verb
from dynreg.cli.completion import recording_names
from dynreg.cli.options import AnyRecording, MapOfLog, Page, RobotOfLog, Seed
from dynreg.errors import UsageError


def register(app: typer.Typer) -> None:
    """Add `drift` to the program."""
    verb(app, "drift")(drift)


def drift(
    call: Call,
    recording: AnyRecording,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="EARLIER",
            help="The recording that may be out of date [the robot's first].",
            autocompletion=recording_names,
        ),
    ] = None,
    sample: Annotated[float, typer.Option(help="Seconds of a piece of a command.")] = 0.5,
    cells: Annotated[int, typer.Option(help="Cells of wheel speeds on each side.")] = 20,
    level: Annotated[float, typer.Option(help="Level of the tests.")] = 0.05,
    welch: Annotated[bool, typer.Option("--welch", help="Do not take variances for equal.")] = False,
    fdr: Annotated[
        bool, typer.Option("--fdr/--no-fdr", help="Keep the false-discovery rate over all tests.")
    ] = True,
    splits: Annotated[
        int, typer.Option(help="Random halves of the earlier recording to measure false alarms by.")
    ] = 200,
    seed: Seed = None,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the updated displacement table, too: a Parquet file."),
    ] = None,
    report: Page = None,
) -> None:
    """Test whether a wheeled robot still moves as an earlier recording says.

    Displacements are compared cell by cell of wheel speeds; what moved is named: left wheel, right wheel, all
    speeds, turns only. It exits 0 whatever the verdict: still true, moved, too little data.

    Example: dynreg drift friday --against monday --report friday.html
    """
    can_write(report)
    can_write(out)
    at_least("--cells", cells, 1)
    at_least("--splits", splits, 0)
    at_least("--seed", seed, 0)
    for flag, value, good, expected in (
        ("--sample", sample, 0 < sample < float("inf"), "seconds above 0"),
        ("--cells", cells, cells <= 200, "1 to 200 cells on each side"),
        ("--level", level, 0 < level < 1, "a level between 0 and 1, such as 0.05"),
    ):
        if not good:
            raise UsageError(f"{flag} {value:g}", expected=expected, do="give another number")
    # both logs may be the first things in a registry
    fresh_logs = (
        robot is not None and against is not None and Path(recording).exists() and Path(against).exists()
    )
    with call.open(create=fresh_logs) as session, call.progress() as progress:
        result = session.drift(
            recording,
            against,
            sample=sample,
            cells=cells,
            level=level,
            welch=welch,
            together=fdr,
            splits=splits,
            seed=call.pick("seed", seed, 0),
            out=out,
            robot=robot,
            log_map=log_map,
            progress=progress,
        )
    if out is not None:
        print(f"{out}: written", file=sys.stderr, flush=True)
    call.emit_and_write(result, report)
