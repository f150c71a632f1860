"""The border where cells of any type become numbers: whole stamps keep their digits, what is no number is NaN."""

import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

_EXACT = 2.0**62  # differences of whole numbers below this cannot overflow int64
_BEYOND = 10**400
_STAMP = 19  # characters of the longest whole number that is read as one: nanoseconds since 1970
EMPTY = ("", "nan", "NaN", "NA", "null", "None")  # what tables write into cells that hold nothing
_DIGITS = 309  # a whole number of more is beyond a double, and Python refuses to read one of 4300


def number(cell: Any) -> float | None:
    """A cell as a double, True as 1; None for text, for what holds more than one value, and beyond a double.

    >>> number(3), number(True), number("3"), number(10**400)
    (3.0, 1.0, None, None)
    """
    if type(cell) is float:  # nearly all are
        return cell
    if not isinstance(cell, bool | int | float | np.number | np.bool_):
        return None
    try:
        return float(cell)
    except (OverflowError, TypeError):  # a complex number has no double either
        return None


def column(cells: Iterable[Any]) -> tuple[np.ndarray, int]:
    """Cells of JSON as (T,) numbers, whole ones as int64 where all fit, and how many are neither number nor null."""
    cells = list(cells)
    numbers = [number(cell) for cell in cells]
    odd = sum(n is None and c is not None for n, c in zip(numbers, cells, strict=True))
    known = [c for c, n in zip(cells, numbers, strict=True) if n is not None]
    if known and all(isinstance(c, int) and -(2**63) <= c < 2**63 for c in known):
        whole = [0 if n is None else c for c, n in zip(cells, numbers, strict=True)]
        return np.ma.masked_array(np.array(whole, dtype=np.int64), [n is None for n in numbers]), odd
    return np.array([math.nan if n is None else n for n in numbers]), odd


def spelled(text: str, point: str = ".") -> int | float | str | None:
    """The number that a text spells, None where it is empty; the text itself where it is no number.

    point : what stands between the whole of a number and its parts.

    >>> spelled("7"), spelled(" 0,5", ","), spelled(""), spelled("ERR"), spelled("1_2")
    (7, 0.5, None, 'ERR', '1_2')
    """
    plain = text.strip().replace(point, ".")
    if plain in EMPTY:
        return None
    if "_" in plain:  # Python reads 1_2 as 12; who numbers runs so does not
        return text
    try:
        value = float(plain)
    except ValueError:
        return text
    whole = plain.lstrip("+-").isdecimal() and len(plain) <= _STAMP
    return int(plain) if whole else value


def doubles(cells: np.ndarray) -> np.ndarray:
    """(T,) float64 of numbers, dates [s since 1970] or spans [s]; NaN where masked or NaT."""
    missing = _missing(cells)
    cells = np.ma.getdata(cells)
    if cells.dtype.kind in "mM":
        out = cells.view(np.int64) * _seconds(cells.dtype)
    else:
        out = cells.astype(np.float64)
    out[missing] = np.nan
    return out


def seconds(stamps: np.ndarray, unit: float) -> tuple[np.ndarray, float]:
    """Time (T,) [s] since the first stamp that is one, and that stamp [s]; NaN for the others.

    unit : [s] of one, for stamps whose type does not tell (dates do). Whole stamps are subtracted as such: a float64
    of nanoseconds since 1970 is only good to 0.2 us.
    """
    missing = _missing(stamps)
    stamps = np.ma.getdata(stamps)
    if stamps.dtype.kind in "mM":
        stamps, unit = stamps.view(np.int64), _seconds(stamps.dtype)
    elif stamps.dtype.kind == "f":
        stamps = stamps.astype(np.float64)
        missing = missing | ~np.isfinite(stamps)
    else:
        stamps = stamps.astype(np.uint64 if stamps.dtype.kind == "u" else np.int64)
    first = int(np.argmin(missing))
    if missing[first]:
        return np.full(len(stamps), np.nan), math.nan
    with np.errstate(invalid="ignore"):  # an infinite stamp is none
        time = since(stamps, stamps[first]) * unit
    time[missing] = np.nan
    return time, float(stamps[first]) * unit


def since(stamps: np.ndarray, start: Any) -> np.ndarray:
    """(T,) float64 of stamps - start; of int64 and uint64 exact before it is rounded, however far they are apart."""
    rough = stamps.astype(np.float64) - float(start)
    if stamps.dtype.kind == "f":
        return rough
    wrapped = stamps.astype(np.uint64) - np.uint64(int(start) % 2**64)
    return np.where(np.abs(rough) < _EXACT, wrapped.astype(np.int64).astype(np.float64), rough)


def parse_json(text: str | bytes) -> Any:
    """JSON of a stranger: a whole number that is too long to be read stands for one beyond a double.

    Raises ValueError and RecursionError.
    """
    return json.loads(text, parse_int=_whole)


def _whole(text: str) -> int:
    return int(text) if len(text) <= _DIGITS + 1 else _BEYOND


def _missing(cells: np.ndarray) -> np.ndarray:
    if np.ma.getdata(cells).dtype.kind in "mM":
        return np.isnat(np.ma.getdata(cells)) | np.ma.getmaskarray(cells)
    return np.ma.getmaskarray(cells)


def _seconds(dtype: np.dtype) -> float:
    """Seconds in one of a date's or a span's units."""
    name, count = np.datetime_data(dtype)
    return count * {"D": 86400.0, "h": 3600.0, "m": 60.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[name]
