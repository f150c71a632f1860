"""The room of a calibration: its words, its tables and its page."""

from collections.abc import Iterator
from typing import Any

from rich.console import Group
from rich.text import Text

from dynreg.errors import command
from dynreg.replay.parts import CUT
from dynreg.report import on_robot
from dynreg.report.drawing import Chart, chart, estimate_track
from dynreg.report.grid import estimate_table, table
from dynreg.report.words import cost_words, count, held_out_words, number, to_hold_out
from dynreg.results.calibration import Calibration

POOR = 0.5  # of the motion: what errs more predicts less than half of it


def verdict(result: Calibration) -> str:
    """The answer in one short sentence."""
    if result.on_robot is not None:
        return on_robot.verdict(result)
    part = "train" if result.test_error is None else "test"
    error, nominal = (
        (result.train_error, result.nominal_train_error)
        if result.test_error is None
        else (result.test_error, result.nominal_test_error)
    )
    named = "" if result.causes is None else f" and named {', '.join(result.causes) or 'no cause'}"
    did = (
        "chose a simulator of"
        if result.method == "nearest"
        else f"fitted {count(_fitted(result), 'parameter')} of"
    )
    recording = result.recording_name or result.recording[:12]
    return (
        f"{result.method} {did} {result.robot} for {recording}{named}: replay error {number(error)} on the {part} part "
        f"(nominal {number(nominal)})."
    )


def _fitted(result: Calibration) -> int:
    """How many parameters the method could move; an older document does not tell, so all of them."""
    return sum(one.free is not False for one in result.parameters.values())


def spent(result: Calibration) -> str:
    """What it cost, in words."""
    simulated = result.cost.simulated_seconds
    more = f", {simulated:.0f} s of simulated time" if simulated else ""
    robot = "" if result.on_robot is None else f"; {on_robot.spent(result)}"
    return f"{cost_words(result.cost)}{more}{robot}"


def made(result: Calibration) -> list[tuple[str, ...]]:
    """Rows of the versions: `VERSIONS`, and figures where a method tells any."""
    rows = [
        (
            v.stage,
            v.simulator[:12],
            v.parent[:12] if v.parent else "nominal",
            number(v.before),
            f"{number(v.after)} {v.unit}".strip(),
            count(len(v.trials), "trial") if result.on_robot else count(len(v.episodes), "episode"),
            ", ".join(f"{name} {number(value)}" for name, value in v.figures.items()),
        )
        for v in result.versions
    ]
    return rows if any(row[-1] for row in rows) else [row[:-1] for row in rows]


VERSIONS = ("stage", "simulator", "from", "objective before", "after", "shaped by")


def columns(rows: list[tuple[str, ...]]) -> tuple[str, ...]:
    """Names of the columns of `made`."""
    return (*VERSIONS, "figures") if rows and len(rows[0]) > len(VERSIONS) else VERSIONS


def next_steps(result: Calibration) -> tuple[str, ...]:
    """What a reader must know of the errors, and what to do next."""
    if result.on_robot is not None:
        return on_robot.next_steps(result)
    return (*_doubts(result), *_tries(result))


def _doubts(result: Calibration) -> Iterator[str]:
    """Why the errors say less than they seem to, and what they say of the model."""
    diagnose = command("diagnose", result.recording_name or result.recording[:12])
    missing = "." if result.method == "diagnose" else f": ask {diagnose} what is missing."
    if result.seen:
        are = "it is" if len(result.seen) == 1 else "they are"
        yield f"The test error is too low: {', '.join(result.seen)} shaped the simulator, though {are} held out."
    if result.train_error > POOR:
        log = command("doctor", "LOG", "--robot", result.robot)
        yield (
            f"Not even what was fitted is explained: the error is {number(result.train_error)} times the motion. Check "
            f"the log with {log}. If it is sound, the model lacks something{missing}"
        )
    if result.test_error is not None and result.test_error > result.nominal_test_error:
        yield (
            f"On the held-out part its error is larger than the nominal simulator's, so it does not carry over{missing}"
        )


def _tries(result: Calibration) -> Iterator[str]:
    """What to do next."""
    same = [v.before is not None and v.before == v.after for v in result.versions]
    if same and all(same):
        yield "Nothing better was found than what it began with: raise --budget, or try another method."
    if result.test_error is None:
        yield to_hold_out(result.parts, CUT)
    else:
        named = result.recording_name or result.recording[:12]
        yield f"Compare: {command('compare', named, '--with', f'nominal,{result.simulator[:12]}')}"


def tables(result: Calibration) -> Group:
    """The fitted parameters, and the errors of the nominal and the fitted simulator, or the gaits on the robot."""
    errors = [
        ("nominal", result.nominal_train_error, result.nominal_test_error),
        (result.method, result.train_error, result.test_error),
    ]
    versions = made(result)
    return Group(
        Text(verdict(result), style="bold"),
        estimate_table(result.parameters, "parameters"),
        table(("", "train", "test"), errors, "replay error (1: as large as the motion)")
        if result.on_robot is None
        else table(
            on_robot.GAITS, on_robot.rows(result.on_robot), f"gaits on the robot [{result.on_robot.unit}]"
        ),
        *([table(columns(versions), versions, "versions")] if versions else []),
        *([Text(f"\n{held}")] if (held := held_out_words(result.parts or {"test": ()})) else []),
        Text(f"\n{spent(result)}"),
        *(Text(f"- {step}") for step in next_steps(result)),
    )


def learning(result: Calibration) -> list[Chart]:
    """A curve for each stage that searched: its lowest objective after so many simulations."""
    drawn = []
    for stage in dict.fromkeys(step.stage for step in result.history):
        own = [step for step in result.history if step.stage == stage]
        title = f"lowest objective of {stage or result.method}"
        drawn.append(
            chart(title, "simulations", [s.simulations for s in own], {"answer": [s.error for s in own]})
        )
    return [one for one in drawn if one is not None]


def page(result: Calibration) -> dict[str, Any]:
    """The template's variables."""
    versions = made(result)
    return {
        "result": result,
        "title": f"{(result.recording or result.method)[:12]} · {result.robot}",
        "verdict": verdict(result),
        "steps": next_steps(result),
        "charts": learning(result) if result.on_robot is None else on_robot.charts(result),
        "gaits": [] if result.on_robot is None else on_robot.rows(result.on_robot),
        "gait_columns": on_robot.GAITS,
        "versions": versions,
        "columns": columns(versions),
        "spent": spent(result).removeprefix("cost: "),
        "held_out": held_out_words(result.parts or {"test": ()}),
        "tracks": {name: estimate_track(e) for name, e in result.parameters.items()},
    }
