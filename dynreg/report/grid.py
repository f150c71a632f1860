"""One table of text, at most as wide as the console."""

from collections.abc import Iterable, Sequence
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from dynreg.report.words import interval, number
from dynreg.results.result import Estimate

KEPT_WHOLE = 32  # a first cell shorter than this is not broken
_LINES = box.SIMPLE_HEAD


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str | None = None) -> RenderableType:
    """A table whose numbers stand to the right; its title is a line of its own above it."""
    rows = [tuple(row) for row in rows]
    out = Table(box=_LINES, show_edge=False, show_header=any(columns), pad_edge=False, header_style="bold")
    for i, name in enumerate(columns):
        numeric = bool(rows) and all(isinstance(row[i], int | float | None) for row in rows)
        short = all(len(str(row[i])) < KEPT_WHOLE for row in rows)
        out.add_column(
            name, justify="right" if numeric else "left", overflow="fold", no_wrap=i == 0 and short
        )
    for row in rows:
        out.add_row(*(cell if isinstance(cell, str) else number(cell) for cell in row))
    return Group(Text(f"\n{title}", style="bold"), out) if title else out


def estimate_table(parameters: dict[str, Estimate], title: str) -> RenderableType:
    """Parameters with their intervals, where they have some, beside the nominal values."""
    value = "value" if all(e.low is None for e in parameters.values()) else "value [90 % interval]"
    rows = [(name, e.nominal, interval(e), e.unit) for name, e in parameters.items()]
    return table(("parameter", "nominal", value, "unit"), rows, title)


def value_text(value: Any) -> str:
    """JSON data in a cell: lists of long texts line by line."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {value_text(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        texts = [value_text(v) for v in value]
        return ("\n" if any(len(text) > KEPT_WHOLE for text in texts) else ", ").join(texts)
    return number(value) if isinstance(value, float) else str(value)
