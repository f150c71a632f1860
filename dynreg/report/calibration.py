"""The room of a calibration: its words, its tables and its page."""

from typing import Any

from rich.console import Group
from rich.text import Text

from dynreg.report.drawing import chart, estimate_track
from dynreg.report.grid import estimate_table, table
from dynreg.report.words import cost_words, count, number
from dynreg.results.calibration import Calibration


def verdict(result: Calibration) -> str:
    """The answer in one short sentence."""
    part = "train" if result.test_error is None else "test"
    error, nominal = (
        (result.train_error, result.nominal_train_error)
        if result.test_error is None
        else (result.test_error, result.nominal_test_error)
    )
    return (
        f"{result.method} fitted {count(len(result.parameters), 'parameter')} of {result.robot} to"
        f" {result.recording[:12]}: replay error {number(error)} on the {part} part (nominal {number(nominal)})."
    )


def next_steps(result: Calibration) -> tuple[str, ...]:
    """What to do next."""
    return (f"Compare with a query: dynreg query {result.recording[:12]}",)


def tables(result: Calibration) -> Group:
    """The fitted parameters, and the errors of the nominal and the fitted simulator."""
    errors = [
        ("nominal", result.nominal_train_error, result.nominal_test_error),
        (result.method, result.train_error, result.test_error),
    ]
    return Group(
        Text(verdict(result), style="bold"),
        estimate_table(result.parameters, "parameters"),
        table(("", "train", "test"), errors, "replay error (1: as large as the motion)"),
        Text(f"\n{cost_words(result.cost)}"),
        *(Text(f"- {step}") for step in next_steps(result)),
    )


def page(result: Calibration) -> dict[str, Any]:
    """The template's variables."""
    steps = [step.simulations for step in result.history]
    errors = {"answer": [step.error for step in result.history]}
    return {
        "result": result,
        "title": f"{result.recording[:12]} · {result.robot}",
        "verdict": verdict(result),
        "steps": next_steps(result),
        "chart": chart("best replay error so far", "simulations", steps, errors),
        "tracks": {name: estimate_track(e) for name, e in result.parameters.items()},
    }
