"""One table of text, at most as wide as the console."""

from collections.abc import Iterable, Sequence
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from dynreg.report.words import interval, interval_words, number
from dynreg.results.result import Estimate

KEPT_WHOLE = 32  # a first cell shorter than this is not wrapped
_LINES = box.SIMPLE_HEAD


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str | None = None) -> RenderableType:
    """A table with right-aligned numbers, under a line with its title."""
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


def estimate_table(parameters: dict[str, Estimate], title: str, reliable: bool = True) -> RenderableType:
    """Parameters with their nominal values and, where they have them, their intervals, reliable or not."""
    value = "value"
    if any(e.low is not None for e in parameters.values()):
        value += f" [{interval_words(reliable)}]"
    rows = [(name, e.nominal, interval(e), e.unit) for name, e in parameters.items()]
    return table(("parameter", "nominal", value, "unit"), rows, title)


def value_text(value: Any) -> str:
    """JSON data as the text of a cell; lists of long texts get one line each."""
    if isinstance(value, dict):
        return ", ".join(f"{k} {value_text(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        texts = [value_text(v) for v in value]
        return ("\n" if any(len(text) > KEPT_WHOLE for text in texts) else ", ").join(texts)
    return number(value) if isinstance(value, float) else str(value)
