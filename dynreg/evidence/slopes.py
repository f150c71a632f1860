"""Derivatives of residuals by differences of rollouts, of many points at once."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynreg.evidence.accuracy import STEP
from dynreg.evidence.data import Sample
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point, bounds

# Derivatives over this width and over STEP differ by 0.02 of their size on a leg in the air and 0.07 on the servo bench
# in MuJoCo; where feet stick and slip, on the leg on the ground, by 1.13 (robots of bench_naming_leg's development).
WIDER, UNEVEN = 0.3, 0.3
NEAR = 1.0  # standard deviations of the nameplate, within which points share derivatives: a ROUGH difference
# Of the width, that a bound must leave for a difference to that side: over less slips tell nothing.
ROOM = 0.3


def sensitivities(
    model: Model, points: Sequence[Point], sample: Sample
) -> Search[tuple[np.ndarray, list[np.ndarray]]]:
    """Residuals (n, W, T, C) of the points, and of each its derivatives (P' + K, W, T, C)."""
    residuals = yield from model.residuals(points, sample)
    return residuals, (yield from slopes(model, points, sample))


def slopes(
    model: Model,
    points: Sequence[Point],
    sample: Sample,
    leading: np.ndarray | None = None,
    side: int = 0,
) -> Search[list[np.ndarray]]:
    """Of each point the derivatives (P' + K, W, T, C) of its residuals; the `leading` ones are taken as they are.

    side : of differences to one side, 0 towards the nameplate, 1 from it.
    """
    first = 0 if leading is None else len(leading)
    central = model.accuracy.sides == 1
    ends = [_ends(model, point, side) for point in points]
    moved = []
    for point, (one, two) in zip(points, ends, strict=True):
        for i in range(first, len(point.z)):
            for end in (one, two) if central else (one,):
                z = point.z.copy()
                z[i] = end[i]
                moved.append(point.moved(z))
    here = [] if central else list(points)
    made = yield from model.sloped.residuals([*here, *moved], sample)
    out, at = [], len(here)
    for number, (point, (one, two)) in enumerate(zip(points, ends, strict=True)):
        own = made[at:][: (len(point.z) - first) * (2 if central else 1)]
        change = own[::2] - own[1::2] if central else own - made[number]
        width = (one - two)[first:]
        slope = change / np.where(np.abs(width) > 1e-9, width, 1e-9)[:, None, None, None]
        out.append(slope if leading is None else np.concatenate([leading, slope]))
        at += len(own)
    return out


def near_another(points: Sequence[Point]) -> list[int]:
    """Of each point the number of the first one before it whose nominal coordinates are near, or its own."""
    out: list[int] = []
    for number, point in enumerate(points):
        leads = (i for i in dict.fromkeys(out) if np.abs(points[i].nominal - point.nominal).max() <= NEAR)
        out.append(next(leads, number))
    return out


def uneven(model: Model, point: Point, sample: Sample) -> Search[bool]:
    """Whether derivatives over a narrow and over a wide difference have little in common: contacts come and go."""
    found = []
    for width in (STEP, WIDER):
        at = replace(model, accuracy=replace(model.accuracy, width=width, nominal=width))
        (slope,) = yield from slopes(at, [point], sample)
        found.append(np.nan_to_num(slope))
    narrow, wide = found
    return bool(np.linalg.norm(narrow - wide) > UNEVEN * np.linalg.norm(wide))


def _ends(model: Model, point: Point, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (D,), first and second, whose residuals' difference is taken: a width to both sides, within bounds.

    To one side: a width to it, or to the other one where a bound leaves too little, and where the point is.
    """
    limits, accuracy = bounds(model.coordinates, point.hypothesis), model.accuracy
    width = np.repeat([accuracy.nominal, accuracy.width], [len(point.nominal), len(point.effect)])
    up, down = np.minimum(point.z + width, limits[:, 1]), np.maximum(point.z - width, limits[:, 0])
    if model.accuracy.sides == 1:
        return up, down
    upwards = (point.z > 0) == bool(side)
    this, other = np.where(upwards, up, down), np.where(upwards, down, up)
    room, rest = np.abs(this - point.z), np.abs(other - point.z)
    return np.where(room > np.minimum(ROOM * width, rest), this, other), point.z
