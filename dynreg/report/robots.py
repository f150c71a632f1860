"""The room of robots: those that come along, the check of a folder, a simulator as a folder."""

import re
from functools import singledispatch

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.errors import RobotError
from dynreg.report.grid import table
from dynreg.report.words import count, first_of
from dynreg.results.result import Result
from dynreg.results.robots import RobotCheck, RobotDraft, RobotFolder, RobotList


@singledispatch
def tables(result: Result) -> RenderableType:
    """The tables of an answer about robots, by its kind."""
    raise TypeError(type(result).__name__)


@tables.register
def _list(result: RobotList) -> RenderableType:
    rows = [
        (r.name, r.title, ", ".join(r.engines), r.control_rate, len(r.channels), len(r.parameters))
        for r in result.robots
    ]
    return table(("robot", "title", "engines", "rate [Hz]", "channels", "parameters"), rows)


@tables.register
def _check(result: RobotCheck) -> str:
    others = result.problems[1:]  # `refusal` tells the first
    lines = [f"error: {line}" for line in others] + [f"warning: {line}" for line in result.warnings]
    counts = [(len(result.problems), "error"), (len(result.warnings), "warning")]
    told = ", ".join(count(how_many, what) for how_many, what in counts if how_many)
    verdict = "sound" if result.sound else "not sound"
    return "\n".join([*lines, f"{result.robot}: {verdict}{f' ({told})' if told else ''}"])


@tables.register
def _folder(result: RobotFolder) -> Group:
    lines: list[RenderableType] = [str(result)]
    if result.effects:
        rows = [(e.effect, ", ".join(e.parameters) or "-", "yes" if e.mjcf else "-") for e in result.effects]
        lines.append(table(("effect", "in robot.toml", f"in {_plain(result)}"), rows))
    lines += [Text(f"warning: {result.warning}", style="bold red")] if result.warning else []
    lines += [f"note: no mujoco.xml: {result.note}"] if result.note else []
    lines += [_to_open(result)] if result.model else []
    return Group(*lines)


def _plain(result: RobotFolder) -> str:
    """The name of the file for MuJoCo alone."""
    return re.split(r"[/\\]", result.mjcf)[-1] if result.mjcf else "mujoco.xml"


def _to_open(result: RobotFolder) -> str:
    """Which of the two models to open where."""
    uncorrected = f"{result.model} is the uncorrected model, which robot.toml corrects"
    if result.mjcf is None:
        return f"{uncorrected}."
    return f"In plain MuJoCo open {result.mjcf}. {uncorrected}: do not open it there."


@tables.register
def _draft(result: RobotDraft) -> Group:
    base = f", free base {result.base}" if result.base else ""
    rows = [
        ("joints", f"{len(result.joints)}, driven {len(result.actions)}{base}"),
        ("commands", f"{_some(result.actions)}, at {result.control_rate:g} Hz"),
        ("channels", f"{len(result.channels)}: {_some(result.channels)}"),
        ("parameters", f"{len(result.parameters)}: {_some(result.parameters, 16)}"),
        ("engines", f"{', '.join(result.engines)}, time step {result.timestep:g} s"),
    ]
    rows += [("map", result.map)] if result.map else []
    rows += [("not in the log", _some(result.missing, 8))] if result.missing else []
    return Group(str(result), table(("", ""), rows), *(f"note: {note}" for note in result.notes))


def _some(names: tuple[str, ...], most: int = 3) -> str:
    """The first few names, and how many there are besides."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def refusal(result: Result) -> RobotError | None:
    """The error of a folder that cannot be used."""
    if not isinstance(result, RobotCheck) or result.sound:
        return None
    problem, expected, do = first_of(result.problems)
    return RobotError(
        f"{result.robot!r} cannot be used: {problem}",
        expected=expected or "a robot folder that can be simulated",
        do=do or "mend its robot.toml or model",
    )
