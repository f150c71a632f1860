"""The room of a plan for a wheeled robot: its tables and its page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.report.plan import plan
from dynreg.report.words import number
from dynreg.results.navigation import Navigation, distance_words


def tables(result: Navigation) -> RenderableType:
    """The commands, the places with the drives that visit them, and how well the model is known."""
    first, second = (f"{name} [{unit}]" for name, unit in zip(result.actions, result.units, strict=True))
    commands = [(c.time, c.seconds, *c.values) for c in result.commands]
    places = [
        (p.x, p.y, "visited" if p.visited else "missed", f"{100 * p.drives / result.drives:.0f} %")
        for p in result.places
    ]
    return Group(
        Text(str(result), style="bold"),
        table(("begin [s]", "lasts [s]", first, second), commands, "commands"),
        table(("ahead [m]", "left [m]", result.on, "drives"), places, f"squares of {result.size:g} m"),
        Text(f"\n{end_words(result)}"),
        Text(error_words(result)),
        *(Text(f"note: {note}") for note in result.notes),
        Text(f"cost: {result.cost.rollouts} plans tried in the model, {result.cost.seconds:.1f} s"),
    )


def end_words(result: Navigation) -> str:
    """Where drives end."""
    low, high = map(distance_words, (result.drive_ends.low, result.drive_ends.high))
    if low.split()[-1] == high.split()[-1]:  # the unit is said once
        low = low.rpartition(" ")[0]
    return f"The middle 90 % of the drives end {low} to {high} from {result.goal}."


def error_words(result: Navigation) -> str:
    """How far off the model is on commands that it was not fitted to."""
    off = ", ".join(f"{axis} {number(spread.mean)} {spread.unit}" for axis, spread in result.errors.items())
    return f"{result.on} ({result.kind}) is off by {off} on average, on {result.parts['test']} held-out commands."


def page(result: Navigation) -> dict[str, Any]:
    """The template's variables."""
    ways = [
        ("model", (result.way.x, result.way.y)),
        *(("drive", (way.x, way.y)) for way in result.ways),
        *(("visited" if p.visited else "missed", p.outline(result.size)) for p in result.places),
    ]
    return {
        "result": result,
        "title": f"{result.recording_name} · plan for {result.robot}",
        "verdict": str(result),
        "drawn": plan("from above; the robot begins at the dot, looking to the right", ways),
        "end": end_words(result),
        "error": error_words(result),
        "off": distance_words(result.end),
    }
