"""`dynreg diagnose`: the physical causes that a simulator of a recorded robot lacks."""

from pathlib import Path
from typing import Annotated

import typer

from dynreg.cli.call import Call, at_least, can_write, verb
from dynreg.cli.completion import effect_names
from dynreg.cli.options import AnyRecording, HoldOut, MapOfLog, Page, RobotOfLog, Seed, Threads, ThresholdRuns


def register(app: typer.Typer) -> None:
    """Add `diagnose` to the program."""
    verb(app, "diagnose")(diagnose)


def diagnose(
    call: Call,
    recording: AnyRecording,
    start: Annotated[
        str,
        typer.Option(
            metavar="ID", help="Simulator to begin from: nominal, nearest (the last query's) or an ID."
        ),
    ] = "nominal",
    hold_out: HoldOut = None,
    effects: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Only these effects [all that fit].", autocompletion=effect_names),
    ] = None,
    without: Annotated[
        str | None, typer.Option(metavar="A,B", help="Not these effects.", autocompletion=effect_names)
    ] = None,
    max_causes: Annotated[int, typer.Option(help="Most causes to name.")] = 3,
    engine: Annotated[str | None, typer.Option(help="One of the robot's engines [its first].")] = None,
    seed: Seed = None,
    threshold_runs: ThresholdRuns = 20,
    tolerance: Annotated[
        float,
        typer.Option(help="Factor on the nameplate's tolerances; above 1 where parameters are guesses."),
    ] = 1.0,
    horizon: Annotated[
        float | None, typer.Option(help="Longest rollout in seconds [the robot's, or 10].")
    ] = None,
    joints: Annotated[
        str | None, typer.Option(metavar="A,B", help="Diagnose these joints alone [all, together].")
    ] = None,
    windows: Annotated[
        int | None, typer.Option(help="Most rollouts to fit, and as many to select by [all].")
    ] = None,
    robot: RobotOfLog = None,
    log_map: MapOfLog = None,
    threads: Threads = None,
    report: Page = None,
) -> None:
    """Name the physical causes that a robot's simulator lacks.

    Parameters and effects are fitted together; an effect is named only above what chance reaches on this
    robot. A finished diagnosis exits 0 whatever its verdict: named, ambiguous, partly_explained, unknown,
    none. It needs no population.

    Example: dynreg diagnose monday --hold-out kp=400 --report monday.html
    """
    can_write(report)
    at_least("--max-causes", max_causes, 1)
    at_least("--threshold-runs", threshold_runs, 0)
    at_least("--seed", seed, 0)
    at_least("--windows", windows, 1)
    at_least("--threads", threads, 0)
    fresh_log = robot is not None and Path(recording).exists()  # it may be the first thing in a registry
    with call.open(create=fresh_log) as session, call.progress() as progress:
        result = session.diagnose(
            recording,
            start=start,
            hold_out=hold_out,
            effects=_names("--effects", effects),
            without=_names("--without", without) or (),
            max_causes=max_causes,
            engine=engine,
            seed=call.pick("seed", seed, 0),
            threshold_runs=threshold_runs,
            tolerance=tolerance,
            horizon=horizon,
            joints=_names("--joints", joints, "joints such as a,b", "dynreg robots"),
            windows=windows,
            robot=robot,
            log_map=log_map,
            threads=call.pick("threads", threads, 0),
            progress=progress,
        )
    call.emit_and_write(result, report)


def _names(
    flag: str, given: str | None, expected: str = "effects such as a,b", see: str = "dynreg effects"
) -> tuple[str, ...] | None:
    """The names of a list with commas; UsageError where there is none in it."""
    if given is None:
        return None
    names = tuple(name.strip() for name in given.split(",") if name.strip())
    if not names:
        from dynreg.errors import UsageError

        raise UsageError(f"{flag} {given!r}", expected=expected, do=f"see `{see}`")
    return names
