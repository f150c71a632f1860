"""Geometry of paths on the ground, seen from above: one scale for both axes, in a square box."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dynreg.report.drawing import Line

SIZE = 1000.0  # of the box, a side
MARGIN = 0.06  # of the side, left free on each
Points = tuple[Sequence[float | None], Sequence[float | None]]  # x and y [m]


@dataclass(frozen=True)
class Plan:
    """Paths as polylines in a square box, their common start, and a scale bar of a round length.

    bar : in percent of the side; bar_label : its length with its unit.
    """

    title: str
    lines: tuple[Line, ...]
    begin: tuple[float, float]
    bar: float
    bar_label: str


def plan(title: str, ways: Sequence[tuple[str, Points]]) -> Plan | None:
    """Paths with their styles, drawn in this order; None if no path has two points."""
    known = [_known(*points) for _, points in ways]
    points = [point for way in known for point in way]
    if len(points) < 2 or all(len(way) < 2 for way in known):
        return None
    xs, ys = zip(*points, strict=True)
    side = max(max(xs) - min(xs), max(ys) - min(ys)) or 1.0
    scale = SIZE * (1.0 - 2.0 * MARGIN) / side
    middle = (0.5 * (min(xs) + max(xs)), 0.5 * (min(ys) + max(ys)))

    def place(x: float, y: float) -> tuple[float, float]:
        return 0.5 * SIZE + scale * (x - middle[0]), 0.5 * SIZE - scale * (y - middle[1])

    lines = tuple(
        Line(style, _path([point and place(*point) for point in _points(*ways[number][1])]))
        for number, ((style, _), way) in enumerate(zip(ways, known, strict=True))
        if len(way) > 1
    )
    length = _round(0.4 * side)
    return Plan(title, lines, place(*points[0]), 100.0 * scale * length / SIZE, _length(length))


def _points(x: Sequence[float | None], y: Sequence[float | None]) -> list[tuple[float, float] | None]:
    return [None if a is None or b is None else (a, b) for a, b in zip(x, y, strict=True)]


def _known(x: Sequence[float | None], y: Sequence[float | None]) -> list[tuple[float, float]]:
    return [point for point in _points(x, y) if point is not None]


def _path(points: Sequence[tuple[float, float] | None]) -> str:
    """A polyline with gaps at unknown points."""
    pairs = zip([None, *points], points, strict=False)
    return "".join(f"{'L' if before else 'M'}{now[0]:.1f} {now[1]:.1f}" for before, now in pairs if now)


def _round(most: float) -> float:
    """The largest of 1, 2, 5, 10, ... that is no more than `most`.

    >>> _round(0.43), _round(0.2), _round(7.0)
    (0.2, 0.2, 5.0)
    """
    power = math.floor(math.log10(most) + 1e-9)
    return round(max(m * 10.0**power for m in (1, 2, 5) if m * 10.0**power <= most * (1.0 + 1e-9)), 12)


def _length(metres: float) -> str:
    """A length with a readable unit.

    >>> _length(0.05), _length(2.0)
    ('5 cm', '2 m')
    """
    return f"{metres:g} m" if metres >= 1.0 else f"{100 * metres:g} cm"
