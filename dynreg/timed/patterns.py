"""What moved: which wheel, at which speeds, or only in turns, from the shifts of many commands.

Every pattern is a factor on what wheels or turns do; a shift is what the robot then moves more (`Reference.changed`).
The factor that explains the shifts best is found by least squares, and patterns are ranked by Schwarz's criterion
beside no change.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

PATTERNS = ("left wheel", "right wheel", "all speeds", "turns only")
LOWEST, HIGHEST = 0.2, 5.0  # of a factor: where it is looked for
EDGE = 1e-3  # relative: the search ends just inside its bounds


@dataclass(frozen=True)
class Pattern:
    """One explanation: the factor (1 where nothing changed) with its standard error, and how much it explains.

    error : inf where the shifts say nothing of the factor. share : of the squared shifts, each in units of its standard
    error. bic : Schwarz's criterion, less is better.
    """

    name: str
    factor: float
    error: float
    share: float
    bic: float

    @property
    def at_bound(self) -> bool:
        """Whether the factor stands where the search ends: what explains the shifts best may lie beyond."""
        return self.factor < LOWEST * (1.0 + EDGE) or self.factor > HIGHEST * (1.0 - EDGE)


def ranked(
    change: Callable[[str, float], np.ndarray], shifts: np.ndarray, errors: np.ndarray
) -> tuple[Pattern, ...]:
    """Explanations of shifts (n, 3) with standard errors (n, 3), the best first; "no change" is among them.

    change : (n, 3) shifts that a pattern brings with a factor, `LOWEST` to `HIGHEST`. Shifts that are NaN were not
    measured.
    """
    known = np.isfinite(shifts) & np.isfinite(errors) & (errors > 0)
    scaled = shifts[known] / errors[known]
    total, many = float(scaled @ scaled), max(int(known.sum()), 1)
    out = [Pattern("no change", 1.0, 0.0, 0.0, total)]
    for name in PATTERNS:

        def residuals(x: np.ndarray, name: str = name) -> np.ndarray:
            return change(name, float(x[0]))[known] / errors[known] - scaled

        found = least_squares(residuals, [1.0], bounds=(LOWEST, HIGHEST))
        rest = float(2.0 * found.cost)
        slope = float(found.jac[:, 0] @ found.jac[:, 0])
        out.append(
            Pattern(
                name,
                float(found.x[0]),
                float(1.0 / np.sqrt(slope)) if slope > 0 else float("inf"),
                1.0 - rest / total if total > 0 else 0.0,
                rest + float(np.log(many)),
            )
        )
    return tuple(sorted(out, key=lambda p: p.bic))
