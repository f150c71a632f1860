"""Geometry of the page's drawings: polylines in a 1000 x 100 box, ticks, and places on a track in percent.

The box is stretched by the browser to the width at hand; words and numbers stay outside of it, as HTML.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dynreg.results.result import Curves, Estimate

WIDTH, HEIGHT = 1000.0, 100.0
MOST_POINTS = 600
ROOM = 14.0  # percent of an axis that a label takes on a phone


@dataclass(frozen=True)
class Line:
    """One polyline: its style's name and SVG path data."""

    style: str
    path: str


@dataclass(frozen=True)
class Tick:
    """A labelled place in percent of an axis."""

    place: float
    label: str


@dataclass(frozen=True)
class Chart:
    """A titled drawing with its axes."""

    title: str
    x_label: str
    lines: tuple[Line, ...]
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]


@dataclass(frozen=True)
class Track:
    """A parameter's axis: the interval, the value, the nominal value and dots, all in percent."""

    left: float
    width: float
    value: float
    nominal: float
    dots: tuple[float, ...]
    low_label: str
    high_label: str


@dataclass(frozen=True)
class Ruler:
    """An axis from zero (or below) on: an interval and a value, with labelled marks, all in percent."""

    left: float
    width: float
    value: float
    marks: tuple[Tick, ...]


def chart(
    title: str, x_label: str, x: Sequence[float], curves: dict[str, Sequence[float | None]]
) -> Chart | None:
    """Curves over common x; None where there is nothing to draw. Missing values break a line."""
    values = [v for curve in curves.values() for v in curve if v is not None]
    if not values or len(x) < 2:
        return None
    xs, ys = ticks(min(x), max(x)), ticks(min(values), max(values))
    x_span, y_span = (min(x), max(x)), _padded(min(values), max(values))
    lines = tuple(Line(style, _path(x, curve, x_span, y_span)) for style, curve in curves.items())
    return Chart(title, x_label, lines, _placed(xs, x_span), _placed(ys, y_span))


def traces(found: Iterable[Curves], order: Sequence[str]) -> list[Chart]:
    """A chart for each that there is something to draw of; where curves run together, the last in `order` is on top."""
    drawn = (
        chart(
            f"{t.channel} [{t.unit}], episode {t.episode}",
            "time [s]",
            t.time,
            {name: curve for name in order if (curve := getattr(t, name)) is not None},
        )
        for t in found
    )
    return [c for c in drawn if c is not None]


def track(
    value: float,
    low: float,
    high: float,
    nominal: float,
    others: Iterable[float],
    limits: tuple[float, float] | None = None,
) -> Track:
    """The axis spans `limits` and everything that is drawn on it."""
    dots = tuple(others)
    drawn = (value, low, high, nominal, *dots)
    span = _padded(min(drawn), max(drawn)) if limits is None else (min(*drawn, *limits), max(*drawn, *limits))
    left, right = _percent(low, span), _percent(high, span)
    return Track(
        left,
        max(right - left, 0.8),  # an interval too small to see is drawn all the same
        _percent(value, span),
        _percent(nominal, span),
        tuple(_percent(dot, span) for dot in dots),
        f"{span[0]:.3g}",
        f"{span[1]:.3g}",
    )


def estimate_track(e: Estimate, others: Iterable[float] = ()) -> Track:
    """The track of a parameter, with the values of others as dots."""
    low, high = (e.value, e.value) if e.low is None else (e.low, e.high)
    return track(e.value, low, high, e.nominal, others, e.limits)


def ruler(value: float, low: float, high: float, marks: dict[str, float]) -> Ruler:
    """The axis spans zero, the interval and the marks; marks stand on the side of the value.

    A mark too near to the next larger one loses its label.
    """
    signed = {name: math.copysign(mark, value) for name, mark in marks.items()}
    drawn = (0.0, value, low, high, *signed.values())
    pad = 0.04 * (max(drawn) - min(drawn)) or 1.0
    span = (min(drawn) - pad * (min(drawn) < 0), max(drawn) + pad * (max(drawn) > 0))
    left, right = _percent(low, span), _percent(high, span)
    return Ruler(
        left,
        max(right - left, 0.8),
        _percent(value, span),
        _spaced([Tick(round(_percent(mark, span), 2), name) for name, mark in signed.items()]),
    )


def ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """Round numbers from low to high.

    >>> ticks(0.0, 6.0)
    [0.0, 2.0, 4.0, 6.0]
    """
    if not high > low:
        return [low]
    rough = (high - low) / wanted
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1, 2, 5, 10) if power * m >= rough)
    first = math.ceil(low / step - 1e-9)
    count = math.floor(high / step + 1e-9) - first
    return [round((first + i) * step, 12) for i in range(count + 1)]


def _path(
    x: Sequence[float], y: Sequence[float | None], x_span: tuple[float, float], y_span: tuple[float, float]
) -> str:
    step = max(1, math.ceil(len(x) / MOST_POINTS))
    out, pen = [], "M"
    for i in range(0, len(x), step):
        if y[i] is None:
            pen = "M"
            continue
        across = WIDTH * _percent(x[i], x_span) / 100
        down = HEIGHT * (1 - _percent(y[i], y_span) / 100)
        out.append(f"{pen}{across:.1f} {down:.2f}")
        pen = "L"
    return "".join(out)


def _placed(values: Sequence[float], span: tuple[float, float]) -> tuple[Tick, ...]:
    """Ticks with as many digits as tell each from the next: six, and more where they lie far from zero."""
    digits, step = 6, values[1] - values[0] if len(values) > 1 else 0.0
    if step > 0.0:
        digits = min(17, max(digits, 1 + math.ceil(math.log10(max(map(abs, values)) / step))))
    return tuple(Tick(round(_percent(v, span), 2), f"{v:.{digits}g}") for v in values)


def _spaced(marks: Iterable[Tick]) -> tuple[Tick, ...]:
    """The marks, the last first in line for its label: those less than `ROOM` from a labelled one have none."""
    out: list[Tick] = []
    for mark in reversed(tuple(marks)):
        near = any(other.label and abs(other.place - mark.place) < ROOM for other in out)
        out.append(Tick(mark.place, "" if near else mark.label))
    return tuple(reversed(out))


def _percent(value: float, span: tuple[float, float]) -> float:
    return 100 * (value - span[0]) / (span[1] - span[0])


def _padded(low: float, high: float) -> tuple[float, float]:
    pad = 0.06 * (high - low) or 0.06 * abs(high) or 1.0
    return low - pad, high + pad
