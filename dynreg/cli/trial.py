"""`dynreg trial`: diagnoses of simulated robots whose truth is known."""

from dataclasses import replace
from typing import Annotated

import typer

from dynreg.cli.call import Call
from dynreg.cli.completion import effect_names
from dynreg.cli.options import Page, RobotFolder
from dynreg.cli.ordinary import ask_about_robot
from dynreg.errors import UsageError
from dynreg.verbs.trial import TrialSettings


def trial(
    call: Call,
    robot: RobotFolder,
    settings: TrialSettings,
    effect: Annotated[
        str | None,
        typer.Option(
            metavar="E[joint]",
            help="What to hide; A+B for two together [one drawn for each robot].",
            autocompletion=effect_names,
        ),
    ] = None,
    nothing: Annotated[bool, typer.Option("--none", help="Hide nothing, and count false alarms.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help="Hide each effect in turn, in -n robots each.")
    ] = False,
    report: Page = None,
) -> None:
    """Hide what the flags say, and diagnose."""
    hide = _hide(effect, nothing, every)
    hidden = () if effect is None else tuple(part.strip() for part in effect.split("+"))
    if not all(hidden):
        raise UsageError(
            f"--effect {effect!r}, in which a name is missing",
            expected="EFFECT, EFFECT[JOINT] or EFFECT+EFFECT",
            do="see `dynreg effects`, or leave --effect out for one drawn for each robot",
        )
    settings = replace(settings, hide=hide, effects=hidden)
    ask_about_robot(call, "trial", robot, vars(settings), report)


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
