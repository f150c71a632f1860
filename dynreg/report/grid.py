"""One table of text, at most as wide as the console."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from dynreg.report.words import interval, interval_words, number
from dynreg.results.result import Estimate

KEPT_WHOLE = 32  # a first cell shorter than this is not wrapped
WORD = 12  # characters that stay together: numbers with their units and ids are no longer
GAP = 3  # characters between two columns
_LINES = box.SIMPLE_HEAD


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str | None = None) -> RenderableType:
    """A table with right-aligned numbers, under a line with its title."""
    out = _Grid(tuple(columns), tuple(tuple(row) for row in rows))
    return Group(Text(f"\n{title}", style="bold"), out) if title else out


@dataclass(frozen=True)
class _Grid:
    """Cells under names. Where they are too wide together, names of columns wrap first, then those of rows.

    Numbers wrap only where nothing else helps: in two lines, 4.32e-05 reads as 4.32e-0.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        cells = [[c if isinstance(c, str) else number(c) for c in row] for row in self.rows]
        numeric = [
            bool(cells) and all(isinstance(row[i], int | float | None) for row in self.rows)
            for i in range(len(self.columns))
        ]
        widths = self._widths(cells, numeric, options.max_width)
        short = all(len(row[0]) < KEPT_WHOLE for row in cells)
        out = Table(
            box=_LINES, show_edge=False, show_header=any(self.columns), pad_edge=False, header_style="bold"
        )
        for i, name in enumerate(self.columns):
            out.add_column(
                name,
                justify="right" if numeric[i] else "left",
                overflow="fold",
                no_wrap=i == 0 and short and widths is None,
                width=widths and widths[i],
            )
        for row in cells:
            out.add_row(*row)
        yield out

    def _widths(self, cells: list[list[str]], numeric: list[bool], most: int) -> list[int] | None:
        """Of the columns, in characters; None where no number would be broken, or nothing keeps them whole."""
        columns = range(len(self.columns))
        longest, words = (
            [_longest(row[i].split(at) for row in cells) for i in columns] for at in ("\n", None)
        )
        whole, room = [*map(max, longest, map(len, self.columns))], most - GAP * (len(columns) - 1)
        named = longest[0] < KEPT_WHOLE
        level = _level(whole[named:], room - named * whole[0])
        out = [wide if wide <= WORD else min(word, WORD) for wide, word in zip(longest, words, strict=True)]
        if sum(out) > room or all(wide <= level for wide, told in zip(longest, numeric, strict=True) if told):
            return None
        if named:
            out[0] += min(room - sum(out), longest[0] - out[0])
        # words of a column's name stay together first, then the narrow columns are served
        unbroken = [*map(max, out, (_longest([name.split()]) for name in self.columns))]
        for wanted in (unbroken, whole):
            while sum(out) < room and (short := [i for i in columns if out[i] < wanted[i]]):
                out[min(short, key=lambda i: out[i])] += 1
        return out


def _level(widths: Sequence[int], room: int) -> int:
    """The width at which rich cuts the widest of columns off, so that all of them fit into `room` characters."""
    return next((w for w in range(room, 0, -1) if sum(min(w, wide) for wide in widths) <= room), 0)


def _longest(texts: Iterable[Sequence[str]]) -> int:
    return max((len(text) for parts in texts for text in parts), default=0)


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
