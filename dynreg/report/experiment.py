"""The room of an experiment between two effects."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.report.words import number
from dynreg.results.experiment import Experiment


def tables(result: Experiment) -> Group:
    """How well it separates, and what it uses of the robot's limits."""
    usual = (
        "" if result.usual is None else f"; the usual commands of that length: {number(result.usual)} nats"
    )
    parts: list[RenderableType] = [Text(str(result) + usual, style="bold")]
    if result.limits:
        rows = [(k.name, k.low, k.high, k.least, k.most, k.unit) for k in result.limits]
        parts.append(table(("limit", "low", "high", "least used", "most used", "unit"), rows))
    parts += [Text(f"note: {result.note}")] if result.note else []
    return Group(*parts)
