"""Many dynamics MLPs of one shape, as plain arrays: 3 hidden layers of 128, ReLU (paper D)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy import ndarray

from dynreg.errors import UsageError
from dynreg.rng import stream

HIDDEN = 128
LAYERS = 4


@runtime_checkable
class Models(Protocol):
    """Models of one shape, some of which can be taken out: an `MlpStack`, or models that are read when asked for."""

    def __len__(self) -> int:
        """How many there are."""
        ...

    def __getitem__(self, ids: ndarray) -> "MlpStack":
        """The models `ids` (m,)."""
        ...


@dataclass(frozen=True)
class MlpStack:
    """M networks of the same sizes, float32, model axis first.

    Attributes
    ----------
    weights : four arrays (M, in, out): D -> 128 -> 128 -> 128 -> S; a row times `weights[0][m]` is layer 0.
    biases : four arrays (M, out).

    Raises UsageError where the shapes do not chain.
    """

    weights: tuple[ndarray, ...]
    biases: tuple[ndarray, ...]

    def __post_init__(self):
        object.__setattr__(self, "weights", tuple(_frozen(w) for w in self.weights))
        object.__setattr__(self, "biases", tuple(_frozen(b) for b in self.biases))
        shapes = [w.shape for w in self.weights]
        chained = (
            len(shapes) == len(self.biases) == LAYERS
            and all(len(s) == 3 and s[0] == shapes[0][0] for s in shapes)
            and all(a[2] == b[1] for a, b in zip(shapes, shapes[1:], strict=False))
            and all(b.shape == (s[0], s[2]) for s, b in zip(shapes, self.biases, strict=True))
        )
        if not chained:
            raise UsageError(
                f"weights of shapes {shapes} with biases of shapes {[b.shape for b in self.biases]}",
                expected=f"{LAYERS} weights (M, in, out) that chain, and biases (M, out)",
                do="take the arrays of one stack, or start with `initial`",
            )

    def __len__(self) -> int:
        return self.weights[0].shape[0]

    def __getitem__(self, ids: int | slice | Sequence[int] | ndarray) -> "MlpStack":
        """The models `ids` (an index, a slice, indices or a mask), always as a stack."""
        picked = np.arange(len(self))
        try:
            picked = np.atleast_1d(picked[ids if isinstance(ids, slice) else _index(ids)])
        except IndexError as error:
            raise UsageError(
                f"no model {ids!r} in a stack of {len(self)}",
                expected=f"indices from 0 to {len(self) - 1}",
                do="check the ids against len(stack)",
            ) from error
        return MlpStack(tuple(w[picked] for w in self.weights), tuple(b[picked] for b in self.biases))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Widths of the layers: (D, 128, 128, 128, S)."""
        return (self.weights[0].shape[1], *(w.shape[2] for w in self.weights))

    def as_arrays(self, dtype: type = np.float16) -> dict[str, ndarray]:
        """Arrays `weight0..3` and `bias0..3` by name, for safetensors.

        float16 halves the registry and moves held-out losses by a few 1e-4. Raises UsageError where a weight
        does not fit into `dtype`.
        """
        named = {f"weight{i}": w for i, w in enumerate(self.weights)}
        named |= {f"bias{i}": b for i, b in enumerate(self.biases)}
        with np.errstate(over="ignore"):
            cast = {name: array.astype(dtype) for name, array in named.items()}
        broken = [name for name, array in cast.items() if not np.isfinite(array).all()]
        if broken:
            raise UsageError(
                f"{broken[0]} holds a number that {np.dtype(dtype).name} cannot",
                expected=f"finite weights up to {np.finfo(dtype).max}",
                do="store float32, or train again with a lower learning rate",
            )
        return cast

    @staticmethod
    def from_arrays(arrays: Mapping[str, ndarray]) -> "MlpStack":
        """The inverse of `as_arrays`. Raises UsageError where an array is missing."""
        names = [f"{kind}{i}" for kind in ("weight", "bias") for i in range(LAYERS)]
        missing = [name for name in names if name not in arrays]
        if missing:
            raise UsageError(
                f"array {missing[0]!r} is missing", expected=f"arrays {names}", do="take what as_arrays wrote"
            )
        return MlpStack(
            tuple(arrays[f"weight{i}"] for i in range(LAYERS)),
            tuple(arrays[f"bias{i}"] for i in range(LAYERS)),
        )


def initial(D: int, S: int, M: int, seed: int, hidden: int = HIDDEN) -> MlpStack:
    """M untrained networks from D inputs to S outputs: uniform in +-1/sqrt(in), as torch's Linear.

    Model m depends on `seed` and m alone.
    """
    sizes = (D, hidden, hidden, hidden, S)
    weights = [np.empty((M, a, b), np.float32) for a, b in zip(sizes, sizes[1:], strict=False)]
    biases = [np.empty((M, b), np.float32) for b in sizes[1:]]
    for m in range(M):
        rng = stream(seed, "mlp", "initial", m)
        for weight, bias in zip(weights, biases, strict=True):
            bound = 1 / np.sqrt(weight.shape[1])
            weight[m] = rng.uniform(-bound, bound, weight[m].shape)
            bias[m] = rng.uniform(-bound, bound, bias[m].shape)
    return MlpStack(tuple(weights), tuple(biases))


def stack_of(stacks: Sequence[MlpStack]) -> MlpStack:
    """All models of `stacks`, in order. Raises UsageError where there is none or their sizes differ."""
    sizes = {stack.sizes for stack in stacks}
    if len(sizes) != 1:
        raise UsageError(
            f"stacks of sizes {sorted(sizes)}",
            expected="at least one, all of the same sizes",
            do="stack one population",
        )
    return MlpStack(
        tuple(np.concatenate([s.weights[i] for s in stacks]) for i in range(LAYERS)),
        tuple(np.concatenate([s.biases[i] for s in stacks]) for i in range(LAYERS)),
    )


def _index(ids: int | Sequence[int] | ndarray) -> ndarray:
    index = np.asarray(ids)
    return index.astype(int) if index.size == 0 else index


def _single(array: ndarray) -> ndarray:
    """Half precision as float32, by torch: the same numbers, ten times as quick as numpy makes them."""
    if np.asarray(array).dtype != np.float16:
        return array
    import torch

    return torch.tensor(np.ascontiguousarray(array)).float().numpy()


def _frozen(array: ndarray) -> ndarray:
    values = np.ascontiguousarray(_single(array), dtype=np.float32).view()
    values.setflags(write=False)
    return values
