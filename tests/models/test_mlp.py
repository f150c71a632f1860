import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack, initial, stack_of
from dynreg.rng import stream


def same(a: MlpStack, b: MlpStack) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a.weights + a.biases, b.weights + b.biases, strict=True))


def test_stacks_are_cut_and_joined_without_loss():
    stack = initial(5, 2, 6, seed=1)
    assert len(stack) == 6 and stack.sizes == (5, 128, 128, 128, 2)
    assert same(stack_of([stack[:2], stack[[2, 3]], stack[np.arange(6) > 3]]), stack)
    assert len(stack[-1]) == 1 and same(stack[-1], stack[5])
    assert len(stack[[]]) == 0


def test_a_model_starts_from_its_number_alone():
    assert same(initial(5, 2, 6, seed=1)[:3], initial(5, 2, 3, seed=1))
    assert not same(initial(5, 2, 3, seed=1), initial(5, 2, 3, seed=2))
    assert not same(initial(5, 2, 2, seed=1)[0], initial(5, 2, 2, seed=1)[1])


def test_float32_arrays_are_exact_and_float16_moves_losses_little():
    rng = stream(0, "half")
    stack, x, y = initial(8, 3, 4, seed=0), rng.normal(size=(100, 8)), rng.normal(size=(100, 3))
    assert same(MlpStack.from_arrays(stack.as_arrays(np.float32)), stack)
    half = stack.as_arrays()
    assert all(array.dtype == np.float16 for array in half.values())
    np.testing.assert_allclose(losses(MlpStack.from_arrays(half), x, y), losses(stack, x, y), rtol=1e-3)


def test_what_is_no_stack_is_refused():
    stack = initial(5, 2, 3, seed=1)
    with pytest.raises(UsageError, match="chain"):
        MlpStack(stack.weights[::-1], stack.biases)
    with pytest.raises(UsageError, match="chain"):
        MlpStack(stack.weights, tuple(b[:2] for b in stack.biases))
    with pytest.raises(UsageError, match="no model 7"):
        stack[7]
    with pytest.raises(UsageError, match="same sizes"):
        stack_of([stack, initial(4, 2, 1, seed=0)])
    with pytest.raises(UsageError, match="'bias3' is missing"):
        MlpStack.from_arrays({k: v for k, v in stack.as_arrays().items() if k != "bias3"})
    loud = MlpStack(tuple(1e6 * w for w in stack.weights), stack.biases)
    with pytest.raises(UsageError, match="float16 cannot"):
        loud.as_arrays()
