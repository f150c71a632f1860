"""The room of ranges for training: what is drawn, and what no model can say."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.results.ranges import RangesFile


def tables(result: RangesFile) -> Group:
    """What is drawn, the effects, and loudly what speaks against relying on it."""
    lines: list[RenderableType] = [str(result)]
    warnings = [warning for warning in (result.warning, result.incomplete) if warning]
    lines += [Text(f"warning: {warning}", style="bold red") for warning in warnings]
    rows = [
        (q.name, q.value, q.low, q.high, q.unit, q.draw, ", ".join(q.reaches) or "-") for q in result.free
    ]
    lines.append(table(("free", "value", "5 %", "95 %", "unit", "draw", "changes"), rows))
    if result.effects:
        carried = [(e.effect, e.carried_by, e.why or "-") for e in result.effects]
        lines.append(table(("effect", "is in", "why not drawn"), carried))
    lines += [f"fixed: {', '.join(result.fixed)}"] if result.fixed else []
    lines += [f"left out: {name}: {why}" for name, why in result.left_out.items()]
    return Group(*lines, *(f"note: {note}" for note in result.notes))
