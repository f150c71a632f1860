"""The border check of every call that takes training or test rows."""

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError


def checked_rows(sizes: tuple[int, ...], inputs: ndarray, targets: ndarray) -> tuple[ndarray, ndarray]:
    """`inputs` (B, N, D) and `targets` (B, N, S) as float32; (N, D) and (N, S) become one set.

    Raises UsageError where they do not fit networks of these `sizes` or each other, where there are no rows,
    or where a number is not finite.
    """
    x, y = checked_inputs(sizes, inputs), _sets(targets)
    if y.ndim != 3 or y.shape[2] != sizes[-1] or y.shape[1] != x.shape[1]:
        raise UsageError(
            f"targets of shape {y.shape} with inputs of shape {x.shape}",
            expected=f"targets (B, {x.shape[1]}, {sizes[-1]}), a row for each row of inputs",
            do="make both from the same transitions with the same normaliser",
        )
    _check_finite("targets", y)
    return x, y


def checked_inputs(sizes: tuple[int, ...], inputs: ndarray) -> ndarray:
    """`inputs` (B, N, D) as float32; (N, D) becomes one set. Raises UsageError as `checked_rows`."""
    x = _sets(inputs)
    if x.ndim != 3 or x.shape[2] != sizes[0] or x.shape[0] == 0 or x.shape[1] == 0:
        raise UsageError(
            f"inputs of shape {x.shape}",
            expected=f"(B, N, {sizes[0]}) with B, N > 0: the networks take {sizes[0]} columns",
            do="make them with the normaliser of the population that the networks belong to",
        )
    _check_finite("inputs", x)
    return x


def _sets(rows: ndarray) -> ndarray:
    rows = np.asarray(rows, dtype=np.float32)
    return rows[None] if rows.ndim == 2 else rows


def _check_finite(name: str, rows: ndarray) -> None:
    # One NaN or infinity makes the sum one too; that costs no array of flags.
    if not np.isfinite(np.sum(rows, dtype=np.float64)):
        at = np.argwhere(~np.isfinite(rows))[0].tolist()
        raise UsageError(
            f"{name}{at} is {rows[tuple(at)]}",
            expected="finite numbers",
            do="drop rows that were not measured",
        )
