"""The one scale that all models of a population share: losses are comparable only on the same normaliser."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynreg.errors import UsageError

FIELDS = ("input_mean", "input_std", "delta_mean", "delta_std")
STILL = 1e-6  # a channel whose spread is below this share of its size carries rounding, not information


@dataclass(frozen=True)
class Normaliser:
    """Mean and standard deviation of model inputs (state, action, context) and of state deltas.

    Attributes
    ----------
    input_mean, input_std : (D,) with D = S + A + K, in the units of the columns.
    delta_mean, delta_std : (S,) of s_t+1 - s_t, in the units of the state.

    Raises UsageError where shapes do not agree, a number is not finite or a deviation is not positive.
    """

    input_mean: ndarray
    input_std: ndarray
    delta_mean: ndarray
    delta_std: ndarray

    def __post_init__(self):
        for name in FIELDS:
            values = np.array(getattr(self, name), dtype=np.float32)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        shapes = [getattr(self, name).shape for name in FIELDS]
        if any(len(s) != 1 for s in shapes) or shapes[0] != shapes[1] or shapes[2] != shapes[3]:
            raise UsageError(
                f"normaliser with shapes {dict(zip(FIELDS, shapes, strict=True))}",
                expected="input_mean and input_std (D,), delta_mean and delta_std (S,)",
                do="take the arrays of one normaliser, or fit a new one with fit_normaliser",
            )
        for name in FIELDS:
            values = getattr(self, name)
            wrong = ~np.isfinite(values) | (name.endswith("std") & (values <= 0))
            if wrong.any():
                raise UsageError(
                    f"normaliser {name} holds {values[wrong][0]}",
                    expected="finite means and positive deviations",
                    do="fit a new one with fit_normaliser on rows without NaN",
                )

    def inputs(
        self,
        states: Float[ndarray, "*rows S"],
        actions: Float[ndarray, "*rows A"],
        context: Float[ndarray, "*rows K"],
    ) -> Float[ndarray, "*rows D"]:
        """Normalised float32 model inputs, columns in the order state, action, context.

        Any leading axes. Raises UsageError where the columns are not those of the fit.
        """
        if states.shape[-1] != len(self.delta_mean):
            raise _columns_error(f"{states.shape[-1]} state columns", f"{len(self.delta_mean)}")
        rows = np.concatenate([states, actions, context], axis=-1, dtype=np.float64)
        if rows.shape[-1] != len(self.input_mean):
            raise _columns_error(f"{rows.shape[-1]} input columns", f"{len(self.input_mean)}")
        return ((rows - self.input_mean) / self.input_std).astype(np.float32)

    def targets(
        self, states: Float[ndarray, "*rows S"], next_states: Float[ndarray, "*rows S"]
    ) -> Float[ndarray, "*rows S"]:
        """Normalised float32 delta from `states` to `next_states`. Any leading axes."""
        if states.shape != next_states.shape or states.shape[-1] != len(self.delta_mean):
            raise _columns_error(
                f"states {states.shape} and next states {next_states.shape}",
                f"equal, (..., {len(self.delta_mean)})",
            )
        # The difference is taken in float64: a delta is often a thousandth of its state.
        delta = np.subtract(next_states, states, dtype=np.float64)
        return ((delta - self.delta_mean) / self.delta_std).astype(np.float32)

    def next_states(
        self, states: Float[ndarray, "*rows S"], predicted: Float[ndarray, "*rows S"]
    ) -> Float[ndarray, "*rows S"]:
        """The states that normalised deltas `predicted` lead to: the inverse of `targets`."""
        return states + predicted * self.delta_std.astype(np.float64) + self.delta_mean

    def as_arrays(self) -> dict[str, ndarray]:
        """Float32 arrays by name, for safetensors."""
        return {name: getattr(self, name) for name in FIELDS}

    @staticmethod
    def from_arrays(arrays: Mapping[str, ndarray]) -> "Normaliser":
        """The inverse of `as_arrays`. Raises UsageError where an array is missing."""
        missing = [name for name in FIELDS if name not in arrays]
        if missing:
            raise UsageError(
                f"normaliser array {missing[0]!r} is missing",
                expected=f"arrays {list(FIELDS)}",
                do="take the arrays that Normaliser.as_arrays wrote",
            )
        return Normaliser(*(arrays[name] for name in FIELDS))


def fit_normaliser(
    states: Float[ndarray, "N S"],
    actions: Float[ndarray, "N A"],
    context: Float[ndarray, "N K"],
    next_states: Float[ndarray, "N S"],
) -> Normaliser:
    """The normaliser of these rows.

    A column that does not move (a setting that is the same in every row, a delta that is all rounding) gets
    the deviation 1 (inputs) or that of its state (deltas), so that it stays near 0 and never explodes.

    Raises UsageError where rows are not finite or their counts differ.
    """
    tables = [np.asarray(table, dtype=np.float64) for table in (states, actions, context, next_states)]
    if any(t.ndim != 2 or len(t) != len(tables[0]) for t in tables) or tables[0].shape != tables[3].shape:
        raise UsageError(
            f"tables of shapes {[t.shape for t in tables]}",
            expected="states (N, S), actions (N, A), context (N, K), next_states (N, S)",
            do="pass one row for each transition",
        )
    rows = np.concatenate(tables[:3], axis=1)
    if len(rows) == 0 or not np.isfinite(rows).all() or not np.isfinite(tables[3]).all():
        raise UsageError(
            f"{len(rows)} transitions, some not finite" if len(rows) else "no transitions",
            expected="at least one row and finite numbers",
            do="drop rows where a channel was not measured",
        )
    delta = tables[3] - tables[0]
    mean, std = rows.mean(0), rows.std(0)
    input_std = np.where(std > STILL * np.maximum(np.abs(mean), STILL), std, 1.0)
    state_std = input_std[: delta.shape[1]]
    delta_std = np.where(delta.std(0) > STILL * state_std, delta.std(0), state_std)
    return Normaliser(mean, input_std, delta.mean(0), delta_std)


def _columns_error(problem: str, expected: str) -> UsageError:
    return UsageError(
        problem, expected=expected, do="give the channels of the population that fitted this normaliser"
    )
