import numpy as np
import pytest
import torch

from dynreg.errors import UsageError
from dynreg.models.base import train_base
from dynreg.models.losses import losses
from dynreg.models.mlp import MlpStack, initial
from dynreg.models.train import Passes, schedule, train
from dynreg.rng import stream


def same(a: MlpStack, b: MlpStack) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a.weights + a.biases, b.weights + b.biases, strict=True))


def planted(systems: int, rows: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (B, N, 3) and targets (B, N, 2) of driven pendulums with gravity and friction of their own."""
    rng = stream(seed, "planted")
    gravity, friction = rng.uniform(0.3, 1.5, (systems, 1)), rng.uniform(0.1, 1, (systems, 1))
    angle, speed, torque = rng.uniform(-2, 2, (3, systems, rows))
    force = torque - gravity * np.sin(angle) - friction * np.tanh(5 * speed)
    return np.stack([angle, speed, torque], -1).astype(np.float32), np.stack([speed, force], -1).astype(
        np.float32
    )


def reference(start, inputs, targets, plan) -> torch.nn.Sequential:
    """The same training by torch.nn and torch.optim.Adam, one model."""
    layers = []
    for i, (weight, bias) in enumerate(zip(start.weights, start.biases, strict=True)):
        linear = torch.nn.Linear(*weight.shape[1:])
        linear.weight.data, linear.bias.data = torch.tensor(weight[0].T), torch.tensor(bias[0])
        layers += [linear, torch.nn.ReLU()] if i < 3 else [linear]
    net = torch.nn.Sequential(*layers)
    optimiser = torch.optim.Adam(net.parameters(), lr=1.0)
    for batch, rate in zip(plan.batches, plan.rates, strict=True):
        optimiser.param_groups[0]["lr"] = float(rate)
        optimiser.zero_grad()
        loss = torch.nn.functional.mse_loss(net(torch.tensor(inputs[batch])), torch.tensor(targets[batch]))
        loss.backward()
        optimiser.step()
    return net


def test_training_is_that_of_torch_with_adam():
    x, y = planted(3, 210)
    start = initial(3, 2, 3, seed=5)
    passes = Passes(epochs=2, learning_rate=1e-3, batch_size=40, seed=7)
    trained = train(start, x, y, passes)
    net = reference(start[1], x[1], y[1], schedule(210, passes))
    for layer, weight, bias in zip(net[::2], trained.weights, trained.biases, strict=True):
        np.testing.assert_allclose(weight[1], layer.weight.detach().numpy().T, atol=1e-5)
        np.testing.assert_allclose(bias[1], layer.bias.detach().numpy(), atol=1e-5)


def test_base_training_is_that_of_torch_too():
    x, y = planted(1, 301)
    passes = Passes(epochs=1, learning_rate=1e-3, batch_size=50, seed=7)
    trained = train_base(x[0], y[0], passes)
    net = reference(initial(3, 2, 1, seed=7), x[0], y[0], schedule(301, passes))
    np.testing.assert_allclose(trained.weights[2][0], net[4].weight.detach().numpy().T, atol=1e-5)


@pytest.mark.parametrize(
    ("columns", "channels", "rows", "batch"), [(55, 33, 200, 100), (13, 5, 137, 30), (3, 1, 75, 37)]
)
def test_a_models_bytes_depend_on_its_own_rows_alone(columns, channels, rows, batch):
    rng = stream(0, "bytes")
    x = rng.normal(size=(9, rows, columns))
    y = np.tanh(x @ rng.normal(size=(columns, channels)))
    start = initial(columns, channels, 9, seed=1)
    passes = Passes(epochs=1, batch_size=batch, seed=3)
    trained = train(start, x, y, passes, chunk=4, threads=1)
    for chunk in (1, 2, 3, 9):
        assert same(train(start, x, y, passes, chunk=chunk, threads=2), trained)
    assert same(train(start[5], x[5], y[5], passes), trained[5])
    assert not same(train(start, x, y, Passes(epochs=1, batch_size=batch, seed=4)), trained)


def test_base_has_the_same_bytes_on_any_number_of_threads():
    x, y = (table.reshape(-1, table.shape[-1]) for table in planted(4, 251))
    one = train_base(x, y, Passes(epochs=1, batch_size=96), threads=1)
    assert same(train_base(x, y, Passes(epochs=1, batch_size=96), threads=2), one)
    assert len(one) == 1


def test_threads_of_the_caller_are_left_as_they_were():
    before = torch.get_num_threads()
    x, y = planted(3, 50)
    train(initial(3, 2, 1, seed=0), x, y, chunk=1, threads=2)
    assert torch.get_num_threads() == before


def test_a_planted_system_is_learned_and_a_warm_start_learns_it_better():
    pool = planted(20, 300, seed=1)
    x, y = planted(4, 600, seed=2)
    base = train_base(*(table.reshape(-1, table.shape[-1]) for table in pool), Passes(8, 2e-3, 64))
    rows, held_out = (x[:, :400], y[:, :400]), (x[:, 400:], y[:, 400:])
    warm = losses(train(base, *rows), *held_out)
    scratch = losses(train(initial(3, 2, 4, seed=0), *rows), *held_out)
    persistence = np.square(held_out[1]).mean(axis=(1, 2))
    pooled = [losses(base, a, b)[0] for a, b in zip(*held_out, strict=True)]
    assert (warm < 0.02 * persistence).all()
    assert (warm < 0.5 * scratch).all() and (scratch < persistence).all()
    assert warm.mean() < 0.7 * np.mean(pooled)


def test_shared_rows_and_a_shared_start_are_those_of_each_model():
    x, y = planted(1, 60)
    start = initial(3, 2, 3, seed=0)
    assert same(train(start, x, y), train(start, np.repeat(x, 3, 0), np.repeat(y, 3, 0)))
    many = np.repeat(y, 3, 0) * np.array([1, 2, 3])[:, None, None]
    assert same(train(start[0], x, many), train(start[[0, 0, 0]], np.repeat(x, 3, 0), many))


def test_every_row_is_taken_once_an_epoch_in_steps_of_even_size():
    plan = schedule(103, Passes(epochs=3, batch_size=20))
    assert len(plan.batches) == 18 and {len(b) for b in plan.batches} == {17, 18}
    for epoch in range(3):
        np.testing.assert_array_equal(
            np.sort(np.concatenate(plan.batches[6 * epoch : 6 * epoch + 6])), np.arange(103)
        )
    assert not np.array_equal(plan.batches[0], plan.batches[6])
    assert (np.diff(plan.rates) < 0).all() and plan.rates[0] == 1e-3 and plan.rates[-1] > 0


def test_bad_calls_are_refused_with_what_was_expected():
    x, y = planted(3, 50)
    start = initial(3, 2, 3, seed=0)
    with pytest.raises(UsageError, match="networks take 3 columns"):
        train(start, x[..., :2], y)
    with pytest.raises(UsageError, match="a row for each row of inputs"):
        train(start, x, y[:, :40])
    with pytest.raises(UsageError, match="expected 1 or 3"):
        train(start, x[:2], y)
    with pytest.raises(UsageError, match="0 epochs"):
        train(start, x, y, Passes(epochs=0))
    broken = y.copy()
    broken[1, 2, 0] = np.nan
    with pytest.raises(UsageError, match=r"targets\[1, 2, 0\] is nan"):
        train(start, x, broken)
    with pytest.raises(UsageError, match="diverged"):
        train(start, x, 1e30 * y, Passes(learning_rate=1e30))
