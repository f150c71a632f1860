"""`dynreg trial`: diagnoses of simulated robots whose truth is known."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynreg.cli.call import Call, at_least, can_write, verb
from dynreg.cli.completion import effect_names
from dynreg.cli.options import Page, RobotFolder, Seed, Threads, ThresholdRuns
from dynreg.errors import UsageError

if TYPE_CHECKING:
    from dynreg.sim.robot import Robot


def register(app: typer.Typer) -> None:
    """Add `trial` to the program."""
    verb(app, "trial")(trial)


def trial(
    call: Call,
    robot: RobotFolder,
    effect: Annotated[
        str | None,
        typer.Option(
            metavar="E[joint]",
            help="What to hide; A+B for two together [one drawn for each robot].",
            autocompletion=effect_names,
        ),
    ] = None,
    size: Annotated[str, typer.Option(help="weak, medium or strong.")] = "medium",
    nothing: Annotated[bool, typer.Option("--none", help="Hide nothing: count the false alarms.")] = False,
    every: Annotated[bool, typer.Option("--all", help="Hide every effect in turn, -n robots each.")] = False,
    count: Annotated[int, typer.Option("-n", help="Robots.")] = 1,
    seed: Seed = None,
    seconds: Annotated[float, typer.Option(help="Length of each robot's log [s].")] = 50.0,
    engine: Annotated[str | None, typer.Option(help="Engine of the diagnosis [the robot's first].")] = None,
    threshold_runs: ThresholdRuns = 20,
    threads: Threads = None,
    report: Page = None,
) -> None:
    """Hide an effect in simulated robots and see whether a diagnosis names it.

    The hidden robots have errors of their nameplate, noise and a finer simulation than the model's.

    Example: dynreg trial servo_pendulum --effect load_friction --size weak -n 10
    """
    can_write(report)
    at_least("-n", count, 1)
    at_least("--threshold-runs", threshold_runs, 0)
    at_least("--seed", seed, 0)
    at_least("--threads", threads, 0)
    asked = {
        "hide": _hide(effect, nothing, every),
        "effects": tuple(part.strip() for part in effect.split("+")) if effect else (),
        "size": size,
        "count": count,
        "seed": call.pick("seed", seed, 0),
        "seconds": seconds,
        "engine": engine,
        "threshold_runs": threshold_runs,
        "threads": call.pick("threads", threads, 0),
    }
    loaded = _checked(robot, asked)
    with call.open(create=True) as session, call.progress() as progress:
        result = session.trial(loaded, **asked, progress=progress)
    call.emit_and_write(result, report)


def _checked(robot: str, asked: dict[str, Any]) -> "Robot":
    """The robot; an error in it or in what is asked is said before a registry is made for it."""
    from dynreg.sim.robot import load_robot
    from dynreg.verbs.trial import TrialSettings

    TrialSettings(**asked)
    return load_robot(robot)


def _hide(effect: str | None, nothing: bool, every: bool) -> str:
    given = {"--effect": effect is not None, "--none": nothing, "--all": every}
    if sum(given.values()) > 1:
        raise UsageError(
            f"{' and '.join(flag for flag, there in given.items() if there)} together",
            expected="at most one of --effect, --none and --all",
            do="leave the others out",
        )
    if effect is not None:
        return "chosen"
    return "nothing" if nothing else "every" if every else "drawn"
