"""What a population's parts must agree in: the arrays of its bank with each other and with its columns, its spec."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

# What all entries of a population are told alike, and the axes of its array: (E, T, width) or (E, width).
AXES = {"actions": 3, "inputs": 3, "settings": 2}


def bank_shape(
    arrays: Mapping[str, np.ndarray], columns: Mapping[str, Sequence[Any]]
) -> tuple[int | None, int | None]:
    """(E, T) of a bank's arrays, None where none tells it; `columns` by group, none of a group that is not told.

    Raises ValueError where an array is missing, or does not fit its columns or the other arrays.
    """
    episodes, steps = None, None
    for group, axes in AXES.items():
        array, told = arrays.get(f"bank.{group}"), columns[group]
        if array is None and told:
            raise ValueError(f"it lacks 'bank.{group}'")
        if array is None:
            continue
        if array.ndim != axes or array.dtype.kind not in "fiu" or (told and array.shape[-1] != len(told)):
            raise ValueError(f"its 'bank.{group}' of shape {array.shape} for {len(told)} columns")
        own = array.shape[0], array.shape[1] if axes == 3 else steps
        episodes, steps = episodes or own[0], steps or own[1]
        if own != (episodes, steps):
            raise ValueError(
                f"its 'bank.{group}' of shape {array.shape} beside {episodes} episodes of {steps}"
            )
    return episodes, steps


def fits_bank(bank: tuple[int | None, int | None], shape: Sequence[int]) -> bool:
    """Whether states of a shape (n, E, T+1, S) are of the episodes and steps of a bank."""
    episodes, steps = bank
    return episodes in (None, shape[1]) and steps in (None, shape[2] - 1)


def check_spec(spec: Mapping[str, Any]) -> None:
    """Raise ValueError where what a spec tells of ranges, of commands or of training is of another kind."""
    for name in ("ranges", "excitation", "training"):
        if not isinstance(spec.get(name, {}), dict):
            raise ValueError(f"its {name!r} is of another kind")
    if not isinstance(spec.get("excitation", {}).get("kinds", []), list):
        raise ValueError("its kinds of commands are no list")
    for name, told in spec.get("ranges", {}).items():
        sound = isinstance(told, list) and len(told) in (2, 3) and all(map(_is_finite, told[:2]))
        if not sound or not all(isinstance(scale, str) for scale in told[2:]):
            raise ValueError(f"the range of {name!r} is {told!r:.80}")


def _is_finite(value: Any) -> bool:
    try:
        return type(value) in (int, float) and math.isfinite(value)
    except OverflowError:
        return False
