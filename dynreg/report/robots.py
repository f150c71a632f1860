"""The room of robots: those that come along, the check of a folder, a simulator as a folder."""

from functools import singledispatch

from rich.console import Group, RenderableType

from dynreg.errors import RobotError
from dynreg.report.grid import table
from dynreg.report.words import first_of
from dynreg.results.result import Result
from dynreg.results.robots import RobotCheck, RobotFolder, RobotList


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
    return "\n".join(result.problems) or f"{result.robot}: sound"


@tables.register
def _folder(result: RobotFolder) -> Group:
    lines: list[RenderableType] = [str(result)]
    if result.effects:
        rows = [(e.effect, ", ".join(e.parameters) or "-", "yes" if e.mjcf else "-") for e in result.effects]
        lines.append(table(("effect", "in robot.toml", "in mujoco.xml"), rows))
    lines += [f"note: no mujoco.xml: {result.note}"] if result.note else []
    return Group(*lines)


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
