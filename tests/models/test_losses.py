import numpy as np
import pytest
import torch

from dynreg.errors import UsageError
from dynreg.models.bank import LossBank, pack
from dynreg.models.forward import TILE
from dynreg.models.losses import losses, predict
from dynreg.models.mlp import MlpStack, initial, stack_of
from dynreg.rng import stream

MODELS, SETS, ROWS = 7, 5, 64


def plain(stack: MlpStack, model: int, inputs: np.ndarray) -> np.ndarray:
    """One model in float64 by torch.nn, the oracle."""
    layers = []
    for i, (weight, bias) in enumerate(zip(stack.weights, stack.biases, strict=True)):
        linear = torch.nn.Linear(*weight.shape[1:], dtype=torch.float64)
        linear.weight.data = torch.tensor(weight[model].T, dtype=torch.float64)
        linear.bias.data = torch.tensor(bias[model], dtype=torch.float64)
        layers += [linear, torch.nn.ReLU()] if i < 3 else [linear]
    return torch.nn.Sequential(*layers)(torch.tensor(inputs, dtype=torch.float64)).detach().numpy()


@pytest.fixture(scope="module")
def stack() -> MlpStack:
    return initial(9, 3, MODELS, seed=2)


@pytest.fixture(scope="module")
def sets() -> tuple[np.ndarray, np.ndarray]:
    rng = stream(0, "sets")
    x, y = rng.normal(size=(SETS, ROWS, 9)), rng.normal(size=(SETS, ROWS, 3))
    return x.astype(np.float32), y.astype(np.float32)


@pytest.fixture(scope="module")
def oracle(stack: MlpStack, sets: tuple) -> np.ndarray:
    return np.array(
        [
            [np.square(plain(stack, m, x) - y).mean() for x, y in zip(*sets, strict=True)]
            for m in range(MODELS)
        ]
    )


@pytest.mark.parametrize("rows", [1, 64, TILE + 37])
def test_predict_is_the_plain_network(stack, rows):
    shared = stream(1, "predict").normal(size=(rows, 9))
    own = stream(2, "predict").normal(size=(MODELS, rows, 9))
    by_shared, by_own = predict(stack, shared), predict(stack, own)
    for m in range(MODELS):
        np.testing.assert_allclose(by_shared[m], plain(stack, m, shared), atol=1e-5)
        np.testing.assert_allclose(by_own[m], plain(stack, m, own[m]), atol=1e-5)


def test_all_pairs_and_chosen_pairs_are_those_of_the_oracle(stack, sets, oracle):
    bank = LossBank(stack, *sets)
    np.testing.assert_allclose(bank.all(), oracle, rtol=1e-5)
    rng = stream(0, "ids")
    models, chosen = rng.integers(MODELS, size=50), rng.integers(SETS, size=50)
    np.testing.assert_allclose(bank.pairs(models, chosen), oracle[models, chosen], rtol=1e-5)
    np.testing.assert_allclose(losses(stack, sets[0][0], sets[1][0]), oracle[:, 0], rtol=1e-5)
    np.testing.assert_allclose(losses(stack[:SETS], *sets), np.diag(oracle), rtol=1e-5)


def test_a_pairs_loss_hardly_depends_on_what_else_is_asked(stack, sets):
    bank = LossBank(stack, *sets)
    whole = bank.all()
    alone = np.array([[bank.pairs([m], [s])[0] for s in range(SETS)] for m in range(MODELS)])
    np.testing.assert_allclose(alone, whole, rtol=1e-6)
    ids = np.divmod(np.arange(MODELS * SETS), SETS)
    np.testing.assert_array_equal(bank.pairs(*ids), whole.ravel())


def test_the_same_call_gives_the_same_bytes_on_any_number_of_threads():
    rng = stream(0, "many")
    many = initial(21, 6, 40, seed=0)
    x, y = rng.normal(size=(12, 100, 21)), rng.normal(size=(12, 100, 6))
    one, two = LossBank(many, x, y, threads=1), LossBank(many, x, y, threads=2)
    np.testing.assert_array_equal(one.all(), two.all())
    ids = rng.integers(40, size=300), rng.integers(12, size=300)
    np.testing.assert_array_equal(one.pairs(*ids), two.pairs(*ids))
    np.testing.assert_array_equal(one.of_set(x[0], y[0]), two.of_set(x[0], y[0]))
    np.testing.assert_array_equal(predict(many, x[0], threads=1), predict(many, x[0], threads=2))


def test_a_bank_answers_for_newcomers_and_keeps_them(stack, sets, oracle):
    x, y = sets
    bank = LossBank(stack[:4], x[:3], y[:3])
    np.testing.assert_allclose(bank.of_set(x[4], y[4]), oracle[:4, 4], rtol=1e-5)
    np.testing.assert_allclose(bank.of_set(x[4], y[4], [3, 1]), oracle[[3, 1], 4], rtol=1e-5)
    np.testing.assert_allclose(bank.of_model(stack[6], [2, 0]), oracle[6, [2, 0]], rtol=1e-5)
    bank.append(stack[4:7], x[3:], y[3:])
    assert bank.shape == (MODELS, SETS)
    np.testing.assert_allclose(bank.all(), oracle, rtol=1e-5)


def test_sets_may_differ_in_length_and_be_longer_than_a_tile(stack):
    rng = stream(3, "long")
    tables = [(rng.normal(size=(n, 9)), rng.normal(size=(n, 3))) for n in (3, 2 * TILE + 5, 40, TILE)]
    bank = LossBank(stack[:4], *tables[0])
    for m, table in enumerate(tables[1:], 4):
        bank.append(stack[m], *table)
    expected = [[np.square(plain(stack, m, x) - y).mean() for x, y in tables] for m in range(MODELS)]
    np.testing.assert_allclose(bank.all(), expected, rtol=1e-5)


def test_jobs_hold_every_pair_once_and_fill_no_more_than_a_tile():
    rng = stream(0, "pack")
    rows = [100, 60, 300, 1]
    models, chosen = rng.integers(5, size=80), rng.integers(4, size=80)
    jobs = pack(models, chosen, rows)
    found = sorted(
        (place, job.model, one) for job in jobs for place, one in zip(job.places, job.sets, strict=True)
    )
    assert found == [(q, models[q], chosen[q]) for q in range(80)]
    assert all(job.rows == sum(rows[s] for s in job.sets) for job in jobs)
    assert all(job.rows <= TILE or len(job.sets) == 1 for job in jobs)


def test_no_pairs_are_no_losses(stack, sets):
    assert LossBank(stack, *sets).pairs([], []).shape == (0,)


def test_bad_ids_and_shapes_are_refused(stack, sets):
    bank = LossBank(stack, *sets)
    with pytest.raises(UsageError, match="numbers from 0 to 6"):
        bank.pairs([0, 7], [0, 0])
    with pytest.raises(UsageError, match="set ids"):
        bank.pairs([0], [-1])
    with pytest.raises(UsageError, match="as many of each"):
        bank.pairs([0, 1], [0])
    with pytest.raises(UsageError, match="one set"):
        bank.of_set(*sets)
    with pytest.raises(UsageError, match="one model"):
        bank.of_model(stack_of([stack, stack]))
    with pytest.raises(UsageError, match="keep to one population"):
        bank.append(initial(8, 3, 1, seed=0), *sets)
    with pytest.raises(UsageError, match="5 sets of rows for 7 models"):
        losses(stack, *sets)
    with pytest.raises(UsageError, match="networks take 9 columns"):
        predict(stack, sets[0][..., 1:])
