"""What a search for a gait raises over the simulators, one line each, and how long it usually is; no heavy imports."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


def _quartile(values: "np.ndarray") -> "np.ndarray":
    import numpy as np

    return np.quantile(values, 0.25, axis=1)


ACCEPT: Mapping[str, Callable[["np.ndarray"], "np.ndarray"]] = {
    "min": lambda values: values.min(axis=1),
    "mean": lambda values: values.mean(axis=1),
    "quantile": _quartile,
}
"""{name: (n,) of fitness (n, k)}: over the k simulators the minimum, the mean, the lower quartile."""
USUAL = "min"  # as in the paper
# Rollouts for each simulator: as many gaits, however many these are. Our own choice: with 400 gaits a search in the
# true simulator that was told no packaged gait stayed behind the packaged ones on most of five quadrupeds.
EACH = 750
