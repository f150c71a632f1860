"""Angles that go far beyond their joint, and may be the counts of an encoder: what their numbers tell of that."""

from dataclasses import dataclass

import numpy as np

ASKED = "counts of an encoder?"
GLITCHES = 0.01  # share of a joint's positions that may be anything, as where a bus fails
IMPOSSIBLE = 1.5  # times its limit that no joint goes, in whatever unit
STEPS = 20  # values of a signal of whole numbers from which on these are many


@dataclass(frozen=True)
class Counted:
    """Why angles may be counts, and what the map then says."""

    why: str
    do: str


SCALE = "set scale = ... (radians per count) and offset = ... (so that the joint's zero is 0)"
PAST_DEGREES = Counted("which the joint cannot do in degrees either", SCALE)
WHOLE = Counted("in whole numbers", f'{SCALE}, or unit = "deg"')


def counted(values: np.ndarray, reach: float) -> Counted | None:
    """What tells of angles (T,) far beyond the `reach` of their joint [rad] that they may be counts; None for degrees.

    reach : inf where it is not known.
    """
    if past_degrees(values, reach):
        return PAST_DEGREES
    return WHOLE if whole(values) else None


def past_degrees(values: np.ndarray, reach: float) -> bool:
    """Whether angles (T,) go further than a joint with this `reach` [rad] can, were they degrees."""
    return usual(values) > IMPOSSIBLE * np.degrees(reach)


def whole(values: np.ndarray) -> bool:
    """Whether a signal (T,) has whole numbers alone, and many of them. Degrees may be so, too."""
    known = values[np.isfinite(values)]
    return bool((known == np.round(known)).all()) and len(np.unique(known)) >= STEPS


def usual(values: np.ndarray) -> float:
    """The largest size of a signal (T,) but for glitches; 0 where it holds no number."""
    sizes = np.abs(values[np.isfinite(values)])
    return float(np.quantile(sizes, 1.0 - GLITCHES)) if len(sizes) else 0.0
