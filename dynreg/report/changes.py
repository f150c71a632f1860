"""The room of what changed between two recordings: its words, its tables and its page."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.errors import command
from dynreg.report.drawing import Ruler, traces
from dynreg.report.grid import table
from dynreg.report.words import interval_text, number
from dynreg.results.changes import AFTER, BEFORE, Change, Changes
from dynreg.results.result import Interval

PAGE = "alone.html"
SIMULATORS = ("nominal", "calibrated", "extended")


def tables(result: Changes) -> RenderableType:
    """What changed, then what did not, and what to do next."""
    parts: list[RenderableType] = [Text(str(result), style="bold")]
    columns = ("", "before", "after", "difference [90 % interval]", "unit", "nats")
    for title, rows in (("what changed", result.changed), ("what did not", _same(result))):
        if rows:
            parts.append(table(columns, [_row(one) for one in rows], title))
    parts.append(Text(f"\n{needed(result)}"))
    parts += [Text(left_words(result))] if result.left else []
    parts += [Text(f"note: {note}") for note in result.notes]
    parts += [Text(f"- {step}") for step in steps(result)]
    return Group(*parts)


def needed(result: Changes) -> str:
    """How much evidence a change takes."""
    return (
        f"A change needs {number(result.threshold_nats)} nats, as a cause does. Values that changed were fitted with"
        " all others shared. The others were fitted to each recording alone."
    )


def left_words(result: Changes) -> str:
    """What the fit to each recording leaves; "" where that was not kept."""
    if not result.left:
        return ""
    before, after = (result.left[name] for name in (BEFORE, AFTER))
    return (
        f"The fit leaves {100 * before.residual:.2g} % of the motion of {result.earlier_name} unexplained, and "
        f"{100 * after.residual:.2g} % of that of {result.recording_name} (sensor noise {100 * after.noise:.2g} %)."
    )


def steps(result: Changes) -> tuple[str, ...]:
    """What to do next."""
    if result.verdict == "unexplained":
        again = command("diagnose", result.recording_name, "--report", PAGE)
        return (
            f"Check the log of {result.recording_name} first: {command('doctor', 'LOG', '--robot', result.robot)}",
            f"Look at {result.recording_name} alone, with all effects: {again}",
            "Play the commands of the earlier recording again. A difference that is then left is not caused by other "
            "motions.",
        )
    if not result.changed:
        return (f"Go on with {result.earlier_name}'s simulator {result.began[:12]}.",)
    use = f"Use simulator {result.answer[:12]} from now on."
    if result.worse:
        use = (
            f"Do not use simulator {result.answer[:12]}: the earlier one, {result.began[:12]}, predicts the "
            f"held-out part of {result.recording_name} better."
        )
    return (
        use,
        "Look at it beside the earlier one: "
        + command("compare", result.recording_name, "--with", f"{result.began[:12]},{result.answer[:12]}"),
    )


def _same(result: Changes) -> list[Change]:
    return [one for one in result.changes if one.same]


def _row(one: Change) -> tuple[Any, ...]:
    values = one.values[BEFORE], one.values[AFTER], one.difference
    return one.name, *(interval_text(v) for v in values), one.unit, f"{one.nats:.1f}"


def page(result: Changes) -> dict[str, Any]:
    """The template's variables."""
    drawn = [s for s in SIMULATORS if any(getattr(t, s) is not None for t in result.traces)]
    best = drawn[-1] if drawn else "nominal"
    order = ("measured", best, "nominal") if best != "nominal" else ("measured", "nominal")
    return {
        "result": result,
        "title": f"{result.recording_name} · what changed on {result.robot}",
        "verdict": str(result),
        "changed": [(one, _rulers(one)) for one in result.changed],
        "same": _same(result),
        "interval_text": interval_text,
        "needed": needed(result),
        "left": left_words(result),
        "steps": steps(result),
        "best": best,
        "charts": traces(result.traces, order),
    }


def _rulers(one: Change) -> list[tuple[str, Interval, Ruler]]:
    """Both recordings' values on the same axis."""
    both = [(name, one.values[name]) for name in (BEFORE, AFTER)]
    ends = [end for _, e in both for end in (e.low, e.high)]
    least, most = min(ends), max(ends)
    room = 0.06 * (most - least) or 1.0
    place = lambda v: 100 * (v - least + room) / (most - least + 2 * room)  # noqa: E731
    return [
        (name, e, Ruler(place(e.low), max(place(e.high) - place(e.low), 0.8), place(e.value), ()))
        for name, e in both
    ]
