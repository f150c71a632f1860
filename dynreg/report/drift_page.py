"""What the page of a drift draws: a map of cells for each axis."""

from dataclasses import dataclass
from typing import Any

from dynreg.report.drawing import Tick, ticks
from dynreg.report.drift_tables import AXES, SHOWN, cell, cells, errors, shown_unit, steps, taken
from dynreg.results import Drift

SHADES = (1.0, 2.0, 3.5, 6.0)  # standard errors from which on a colour is a shade darker


@dataclass(frozen=True)
class Square:
    """One cell on a map of 0 to 100 on both sides: its corner, its shade (-4 to 4), and what it says."""

    x: float
    y: float
    shade: int
    rejected: bool
    label: str


@dataclass(frozen=True)
class Map:
    """The shifts on one axis: a square for each cell that was tested, `size` wide."""

    title: str
    size: float
    squares: tuple[Square, ...]
    ticks: tuple[Tick, ...]


def drift_page(result: Drift) -> dict[str, Any]:
    """The template's variables."""
    return {
        "result": result,
        "title": f"{result.recording_name} · drift of {result.robot}",
        "verdict": str(result),
        "maps": [_map(result, axis, name) for axis, name in AXES.items()] if result.cells else [],
        "shades": range(1, len(SHADES) + 1),
        "bounds": SHADES,
        "strongest": [(c, cells(c)) for c in result.moved[:SHOWN]],
        "columns": [f"{name} [{shown_unit(result, axis)}]" for axis, name in AXES.items()]
        if result.cells
        else [],
        "errors": errors(result),
        "taken": [taken(result.earlier), taken(result.recent)],
        "steps": steps(result),
    }


def _map(result: Drift, axis: str, name: str) -> Map:
    span = result.high - result.low
    size = 100.0 / result.grid
    squares = []
    for c in result.cells:
        if axis not in c.shifts:
            continue
        shift = c.shifts[axis]
        size_of_it = sum(abs(shift.sigmas) >= bound for bound in SHADES)
        squares.append(
            Square(
                100.0 * (c.left - result.low) / span - size / 2,
                100.0 * (result.high - c.right) / span - size / 2,
                size_of_it if shift.sigmas > 0 else -size_of_it,
                shift.rejected,
                f"left {c.left:+.3f}, right {c.right:+.3f} m/s: {cell(shift)} {shown_unit(result, axis)}"
                f" ({shift.sigmas:+.1f})",
            )
        )
    places = ticks(result.low, result.high, 4)
    return Map(
        name,
        size,
        tuple(squares),
        tuple(Tick(round(100.0 * (at - result.low) / span, 2), f"{at:g}") for at in places),
    )
