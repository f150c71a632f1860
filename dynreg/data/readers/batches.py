"""Arrow tables that come batch by batch (CSV, Parquet) become columns: numbers, dates, and text as labels."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from dynreg.data.clock_names import is_clock
from dynreg.data.maps import odd_text
from dynreg.data.readers import ReadOptions
from dynreg.data.readers.budget import Budget
from dynreg.data.readers.columns import from_columns, time_column
from dynreg.data.readers.numbers import column, doubles, spelled
from dynreg.data.readers.signals import MAX_ITEMS
from dynreg.data.series import Finding, RawLog
from dynreg.errors import LogError


def is_text(kind: pa.DataType) -> bool:
    """Whether a column's cells are text."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def is_listed(kind: pa.DataType) -> bool:
    """Whether a column's cells are lists of numbers."""
    lists = pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind)
    return lists and _is_plain(kind.value_type)


def is_number(kind: pa.DataType) -> bool:
    """Whether a column's cells are numbers, dates or spans, or all empty."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    dated = pa.types.is_timestamp(kind) or pa.types.is_duration(kind)
    return _is_plain(kind) or dated or pa.types.is_decimal(kind) or pa.types.is_null(kind)


def _is_plain(kind: pa.DataType) -> bool:
    return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)


@dataclass
class Columns:
    """The columns of one table, gathered batch by batch; a column that a batch lacks is empty there."""

    path: Path
    budget: Budget
    options: ReadOptions
    point: str = "."  # between the whole of a number and its parts, where numbers are text
    rows: int = 0
    names: tuple[str, ...] = ()
    wanted: tuple[str, ...] = ()  # those asked for, and those that may be the time
    findings: list[Finding] = field(default_factory=list)
    _numbers: dict[str, list[np.ndarray]] = field(default_factory=dict)
    _texts: dict[str, list[pa.Array]] = field(default_factory=dict)
    _units: dict[str, str] = field(default_factory=dict)
    _widths: dict[str, int] = field(default_factory=dict)
    _others: set[str] = field(default_factory=set)

    def named(self, names: Sequence[str]) -> None:
        """Take the names of all columns; the spaces and "#" around them are no part of them.

        Raises LogError where they are too many, none is asked for, or two that are have one name.
        """
        self.budget.check("columns", len(names))
        self.names = tuple(name.strip().lstrip("# ") for name in names)
        clock = self.options.time
        wanted = [
            n
            for n in self.names
            if (n == clock if clock else is_clock(n)) or n and self.options.wants_signal(n)
        ]
        twice = [n for n, count in Counter(wanted).items() if count > 1]
        if twice:
            raise LogError(
                f"{self.path.name!r} has two columns named {twice[0]!r}",
                expected="a name for each column",
                do="rename one of them",
            )
        if not wanted:
            time_column(self.path, (), self.options, self.names)
        self.wanted = tuple(wanted)

    def add(self, batch: pa.RecordBatch | pa.Table) -> None:
        """Take the next rows; LogError past a limit."""
        self.budget.spend("rows", batch.num_rows)
        for about, cells in zip(batch.schema, batch.columns, strict=True):
            if isinstance(cells, pa.ChunkedArray):
                cells = cells.combine_chunks()
            self._unit(about)
            if is_text(about.type):
                self._text(about.name, cells)
            elif is_listed(about.type):
                self._lists(about.name, cells)
            elif is_number(about.type):
                self._keep(about.name, _array(cells))
            else:
                self._others.add(about.name)
        self.rows += batch.num_rows

    @property
    def mixed(self) -> tuple[str, ...]:
        """Columns that were numbers in one batch and text in another."""
        return tuple(name for name in self._texts if name in self._numbers)

    def log(self, extra: Mapping[str, np.ndarray]) -> RawLog:
        """The log of all rows; `extra` are columns from elsewhere.

        Raises LogError where there are no rows, a column is half text, or none is the time.
        """
        if self.rows == 0:
            raise LogError(
                f"{self.path.name!r} has no rows", expected="at least two samples", do="record it again"
            )
        if self.mixed:
            raise LogError(
                f"{self.path.name!r}: column {self.mixed[0]!r} holds numbers in one part and text in another",
                expected="one kind of cells",
                do="mend the log",
            )
        kept = [n for n in self._numbers if n not in self._others]
        labels = {n: _labels([*parts, pa.nulls(self._short(parts))]) for n, parts in self._texts.items()}
        columns = {n: self._whole(n) for n in kept} | self._spelled(labels) | dict(extra)
        units = {n: self._units.get(n, self._units.get(n.rpartition("[")[0])) for n in columns}
        return from_columns(
            self.path,
            columns,
            self.options,
            labels=labels,
            units={n: unit for n, unit in units.items() if unit is not None},
            findings=tuple(self.findings),
            names=tuple(dict.fromkeys((*self.names, *columns))),
        )

    def _spelled(self, labels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns of text of which most cells are numbers, as these; a finding counts the others, which are empty.

        One that is numbers throughout was meant as text by whoever gave it that type.
        """
        out = {}
        for name, texts in labels.items():
            known = {text: spelled(text, self.point) for text in dict.fromkeys(texts)}
            cells = [known[text] for text in texts]
            odd = sum(isinstance(cell, str) for cell in cells)
            if 0 < odd < sum(isinstance(cell, int | float) for cell in cells):
                self.budget.spend("numbers", len(cells))
                out[name], _ = column(cells)
                text = f"{odd_text(cells)}: where numbers are asked for they are empty"
                self.findings.append(Finding("warning", "left_out", f"{self.path.name}, {name}", text))
        return out

    def _whole(self, name: str) -> np.ndarray:
        """A column in one piece, and its pieces given up: both of all columns would take the memory twice."""
        parts = self._numbers.pop(name)
        return _joined([*parts, _empty(self._short(parts))])

    def _short(self, parts: Sequence[Any]) -> int:
        return self.rows - sum(len(part) for part in parts)

    def _unit(self, about: pa.Field) -> None:
        unit = (about.metadata or {}).get(b"unit")
        if unit is None or about.name in self._units:
            return
        try:
            self._units[about.name] = unit.decode()
        except UnicodeDecodeError:
            where = f"{self.path.name}, {about.name}"
            told = f"its unit {unit[:20]!r} is no text and is left out"
            finding = Finding("warning", "left_out", where, told, "set `unit` in the map")
            if finding not in self.findings:
                self.findings.append(finding)

    def _keep(self, name: str, cells: np.ndarray) -> None:
        if name not in self._numbers:
            self.budget.spend("columns")
        parts = self._numbers.setdefault(name, [])
        missing = self._short(parts)
        self.budget.spend("numbers", len(cells) + missing)
        parts += [_empty(missing), cells] if missing else [cells]

    def _text(self, name: str, cells: pa.Array) -> None:
        if name not in self._texts:
            self.budget.spend("columns")
        parts = self._texts.setdefault(name, [])
        cells = cells if pa.types.is_dictionary(cells.type) else cells.dictionary_encode()
        missing = self._short(parts)
        # each cell is a reference; each text that is met takes its bytes and what Python adds to them
        self.budget.spend(
            "numbers", len(cells) + missing + 8 * len(cells.dictionary) + cells.dictionary.nbytes // 8
        )
        parts += [pa.nulls(missing), cells] if missing else [cells]

    def _lists(self, name: str, cells: pa.Array) -> None:
        if pa.types.is_fixed_size_list(cells.type):
            cells = cells.cast(pa.list_(cells.type.value_type))
        lengths = pc.fill_null(pc.list_value_length(cells), 0).to_numpy(zero_copy_only=False).astype(np.int64)
        width = self._widths[name] = max(int(lengths.max(initial=0)), self._widths.get(name, 0))
        if width > MAX_ITEMS:  # no signal, an image
            for i in range(MAX_ITEMS):
                self._numbers.pop(f"{name}[{i}]", None)
            return
        flat = doubles(_array(cells.flatten()))
        row = np.repeat(np.arange(len(cells)), lengths)
        place = np.arange(len(flat)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        out = np.full((width, len(cells)), np.nan)
        out[place, row] = flat
        for i, items in enumerate(out):
            self._keep(f"{name}[{i}]", items)


def _array(cells: pa.Array) -> np.ndarray:
    """(T,) numbers or dates; whole numbers stay whole, masked where they are empty."""
    kind = cells.type
    if pa.types.is_dictionary(kind):
        return _array(cells.dictionary_decode())
    if pa.types.is_null(kind):
        return _empty(len(cells))
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        return cells.to_numpy(zero_copy_only=False)
    if pa.types.is_boolean(kind):
        cells = cells.cast(pa.int8())
    if pa.types.is_integer(cells.type):
        empty = cells.is_null().to_numpy(zero_copy_only=False) if cells.null_count else np.ma.nomask
        whole = cells.fill_null(0).to_numpy() if cells.null_count else cells.to_numpy()
        return np.ma.masked_array(whole, empty) if cells.null_count else whole
    return cells.cast(pa.float64()).fill_null(float("nan")).to_numpy()


def _empty(count: int) -> np.ndarray:
    """Cells that hold nothing, of a type that any other takes in."""
    return np.ma.masked_all(count, dtype=np.int8)


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    kinds = {part.dtype for part in parts if part.dtype.kind in "mM"}
    parts = [part for part in parts if len(part)]
    if len(parts) == 1:
        return parts[0]
    if len(kinds) == 1 and all(part.dtype.kind in "mM" or np.ma.getmaskarray(part).all() for part in parts):
        (kind,) = kinds
        return np.concatenate([p if p.dtype == kind else np.full(len(p), "NaT", kind) for p in parts])
    if kinds:  # dates of two kinds, or dates and numbers
        return np.concatenate([doubles(part) for part in parts])
    return np.ma.concatenate(parts) if any(np.ma.isMA(p) for p in parts) else np.concatenate(parts)


def _labels(parts: Sequence[pa.Array]) -> np.ndarray:
    """(T,) text, "" where a cell is empty; cells of one text are one object, however long it is."""
    out = []
    for part in parts:
        if pa.types.is_null(part.type):
            out.append(np.full(len(part), "", dtype=object))
            continue
        texts = np.array([*(str(t) for t in part.dictionary.to_pylist()), ""], dtype=object)
        out.append(texts[part.indices.fill_null(len(texts) - 1).to_numpy()])
    return np.concatenate(out)
