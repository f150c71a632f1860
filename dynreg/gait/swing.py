"""The way of a foot through the air: a spline through five knots."""

import numpy as np


def swung(g: dict[str, np.ndarray], end: str, swing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, K) how far ahead and up [m] a foot is at shares (n, K) of its time in the air.

    Catmull-Rom: at a knot the foot moves as from the knot before to the one after. It leaves and meets the ground as
    fast as the ground moves under the robot.
    """
    zero, lift = np.zeros_like(g["lift_time"]), g["lift_time"]
    knots = np.concatenate([zero, lift, zero + 0.5, 1.0 - lift, zero + 1.0], axis=1)
    shape, box = g["shape"], np.array([-1.0, -1.0, 0.0, 1.0, 1.0])
    ahead = 0.5 * g["length"] * ((1 - shape) * box - shape * np.cos(np.pi * knots))
    high = np.concatenate(
        [zero, *(g[f"{end}_{stage}"] for stage in ("lift", "air", "descent")), zero], axis=1
    )
    up = g["lift"] * high * ((1 - shape) + shape * np.sin(np.pi * knots))
    ground = -g["length"] * g["air"] / (1.0 - g["air"])
    return _spline(knots, ahead, ground, swing), _spline(knots, up, zero, swing)


def _spline(knots: np.ndarray, values: np.ndarray, ends: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(n, K) cubic Hermite spline through values (n, 5) at knots (n, 5), with slope `ends` (n, 1) at both ends."""
    inner = (values[:, 2:] - values[:, :-2]) / (knots[:, 2:] - knots[:, :-2])
    slopes = np.concatenate([ends, inner, ends], axis=1)
    piece = (at[..., None] >= knots[:, None, 1:-1]).sum(axis=-1)
    take = lambda a, i: np.take_along_axis(a, i, axis=1)  # noqa: E731
    begin, wide = take(knots, piece), take(knots, piece + 1) - take(knots, piece)
    s = (at - begin) / wide
    first, last = take(values, piece), take(values, piece + 1)
    out, into = wide * take(slopes, piece), wide * take(slopes, piece + 1)
    blend = s * s * (3 - 2 * s)
    return first + blend * (last - first) + s * (1 - s) * ((1 - s) * out - s * into)
