"""The room of an experiment between two effects."""

from rich.console import Group, RenderableType
from rich.text import Text

from dynreg.report.grid import table
from dynreg.report.words import number
from dynreg.results.experiment import Experiment


def tables(result: Experiment) -> Group:
    """The expected evidence, and the robot's limits beside the range that the commands use."""
    parts: list[RenderableType] = [Text(str(result), style="bold")]
    if result.usual is not None:
        parts.append(Text(f"The usual commands of this length separate them by {number(result.usual)} nats."))
    if result.limits:
        rows = [(k.name, k.low, k.high, k.least, k.most, k.unit) for k in result.limits]
        parts.append(table(("limit", "low", "high", "least used", "most used", "unit"), rows))
    parts += [Text(f"note: {result.note}")] if result.note else []
    return Group(*parts)
