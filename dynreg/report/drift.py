"""The room of a drift: its words, its tables and its page, a map of cells for each axis."""

import math
from dataclasses import dataclass
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.errors import command
from dynreg.report.drawing import Tick, ticks
from dynreg.report.grid import table
from dynreg.report.words import count, number
from dynreg.results.drift import Drift, DriftCell, Shift, Taken
from dynreg.verbs.drift import DriftSettings

SHOWN = 12  # cells
UNITS = {"m": ("mm", 1000.0), "rad": ("deg", math.degrees(1.0))}  # as people read them
AXES = {"dx": "to the right", "dy": "ahead", "dtheta": "turned left"}
SHADES = (1.0, 2.0, 3.5, 6.0)  # standard errors from which on a colour is a shade darker


def tables(result: Drift) -> RenderableType:
    """Its patterns, what moved most, and how often the test errs."""
    moved = result.moved
    title = f"{count(len(moved), 'cell')} moved" + (f", the {SHOWN} strongest" if len(moved) > SHOWN else "")
    parts: list[RenderableType] = [Text(str(result), style="bold")]
    if result.patterns:
        parts.append(pattern_table(result))
    if moved:
        rows = [
            (f"{c.left:+.3f}", f"{c.right:+.3f}", f"{c.earlier}, {c.recent}", *cells(c))
            for c in moved[:SHOWN]
        ]
        columns = ("left [m/s]", "right [m/s]", "samples", *(f"{a} [{shown_unit(result, a)}]" for a in AXES))
        parts.append(table(columns, rows, f"{title}: shift +- standard error, * rejected"))
    parts += [Text(f"\n{errors(result)}"), Text(taken(result.earlier)), Text(taken(result.recent))]
    parts += [Text(f"note: {note}") for note in result.notes]
    parts += [Text(f"- {step}") for step in steps(result)]
    return Group(*parts)


def pattern_table(result: Drift) -> RenderableType:
    """Every explanation, the best first."""
    rows = [
        (
            p.name,
            p.factor,
            f"{p.low:.3f} to {p.high:.3f}{' (at a bound)' if p.at_bound else ''}",
            f"{100 * p.share:.0f} %",
            p.evidence,
        )
        for p in result.patterns
    ]
    columns = ("pattern", "factor", "95 % interval", "of the squared shifts", "evidence")
    return table(
        columns, rows, "patterns that explain the shifts (evidence relative to no change; 10 is very strong)"
    )


def cells(of: DriftCell) -> tuple[str, ...]:
    """Its shifts in the order of `AXES`, "-" where an axis was not tested."""
    return tuple(cell(of.shifts[axis]) if axis in of.shifts else "-" for axis in AXES)


def cell(shift: Shift) -> str:
    """A shift with its standard error in units that people read, marked where it is rejected."""
    factor = UNITS[shift.unit][1]
    mark = " *" if shift.rejected else ""
    return f"{factor * shift.value:+.2f} +- {factor * shift.error:.2f}{mark}"


def shown_unit(result: Drift, axis: str) -> str:
    """The unit in which an axis' shifts are shown."""
    return next(UNITS[c.shifts[axis].unit][0] for c in result.cells if axis in c.shifts)


def errors(result: Drift) -> str:
    """How often the test errs."""
    f = result.false_alarms
    rule = "false-discovery rate" if result.together else "level of each test"
    text = (
        f"{result.test.capitalize()}'s test, {rule} {f.level:g}: one by one, {number(f.expected)} of {result.tests}"
        f" tests would be rejected if nothing had moved"
    )
    if f.splits and f.one_by_one is not None:
        text += (
            f"; in {f.splits} random halves of the earlier recording (by {f.by}, {f.tests:.0f} tests each)"
            f" {100 * f.one_by_one:.1f} % were below the level, and {100 * f.alarms:.1f} % of the splits"
            f" raised an alarm (they share their data: this share scatters widely)"
        )
    return text


def taken(of: Taken) -> str:
    """What of a recording was tested."""
    out = [
        f"{many} {what}"
        for many, what in ((of.short, "too short"), (of.long, "too long"), (of.outside, "out of range"))
        if many
    ]
    others = f", left out: {', '.join(out)}" if out else ""
    return f"{of.name}: {count(of.samples, 'sample')} of {count(of.pieces, 'piece')}{others}"


def steps(result: Drift) -> tuple[str, ...]:
    """What to do next, the first thing first."""
    if result.verdict == "still true":
        return (f"Go on with {result.earlier.name}.",)
    if result.verdict == "too little data":
        return (
            f"Record more commands, each {result.sample:g} s or longer and several times, or give fewer --cells.",
        )
    out = []
    if result.separate_by:
        told = "; ".join(f"left {s.left:+.2f}, right {s.right:+.2f} m/s" for s in result.separate_by)
        later = ""
        if not any(s.known for s in result.separate_by):
            later = f" {result.earlier.name} has none of these: they will tell from the next time on."
        out.append(
            f"To tell {' from '.join(result.rivals[:2])}, record {told} ({result.sample:g} s each, several times)."
            f"{later}"
        )
    if not result.kept:
        out.append(f"Keep the updated table: {again(result)} --out table.parquet")
    return tuple(out)


def again(result: Drift) -> str:
    """The command line that makes the same tests again; settings that are the usual ones are left out."""
    usual = DriftSettings()
    asked = {
        "--sample": (result.sample, usual.sample),
        "--cells": (result.grid, usual.cells),
        "--level": (result.false_alarms.level, usual.level),
        "--seed": (result.seed, usual.seed),
    }
    words = ["drift", result.recording_name, "--against", result.earlier.name]
    words += [word for flag, (value, same) in asked.items() if value != same for word in (flag, f"{value!r}")]
    words += ["--welch"] * (result.test == "welch") + ["--no-fdr"] * (not result.together)
    return command(*words)


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


def page(result: Drift) -> dict[str, Any]:
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
