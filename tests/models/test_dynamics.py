"""Models that are taken out predict as the store's own do, in numpy and in torch, one or many at once."""

from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.errors import UsageError
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack

torch = pytest.importorskip("torch")


@pytest.fixture(scope="module")
def reg(registry_folder: Path):
    with dynreg.open(registry_folder) as reg:
        yield reg


@pytest.fixture(scope="module")
def rows(reg):
    data = reg.dataset(reg.population("servo_pendulum").id[3]).to_numpy()
    return data.states[::40], data.actions[::40], data.context[::40]


def test_a_step_is_what_the_networks_say_in_physical_units(reg, rows):
    ids = list(reg.population("servo_pendulum").id)
    model, (states, actions, context) = reg.model([ids[5], ids[2]]), rows
    held, record = reg.registry.load("servo_pendulum"), reg.registry.population("servo_pendulum")
    n = {
        k: record.arrays[f"normaliser.{k}"].astype(float)
        for k in ("input_mean", "input_std", "delta_mean", "delta_std")
    }
    inputs = (np.concatenate([states, actions, context], axis=1) - n["input_mean"]) / n["input_std"]
    delta = predict(MlpStack.from_arrays(held.weights)[[5, 2]], inputs.astype(np.float32))
    expected = states + delta * n["delta_std"] + n["delta_mean"]
    assert model.entries == (ids[5], ids[2]) and len(model) == 2
    np.testing.assert_allclose(model.predict(states, actions, context), expected, rtol=1e-12)


def test_one_alone_many_together_and_a_population_agree(reg, rows):
    ids = list(reg.population("servo_pendulum").id)
    whole = reg.model("servo_pendulum").predict(*rows)
    assert whole.shape == (8, len(rows[0]), 2)
    for i in (0, 7):
        alone = reg.model(ids[i]).predict(*rows)
        assert alone.shape == (len(rows[0]), 2)
        np.testing.assert_array_equal(alone, whole[i])


def test_several_steps_go_on_from_what_was_predicted(reg, rows):
    model, (states, actions, context) = reg.model("servo_pendulum"), rows
    several = np.stack([actions, actions + 0.1, actions - 0.1], axis=1)
    found = model.predict(states, several, context, steps=3)
    now = states
    for step in range(3):
        now = model.predict(now, several[:, step], context)
        np.testing.assert_array_equal(found[:, :, step], now)


def test_rows_of_each_models_own(reg, rows):
    model, (states, actions, context) = reg.model("servo_pendulum"), rows
    own = np.stack([states + 0.01 * i for i in range(8)])
    found = model.predict(own, actions, context)
    np.testing.assert_array_equal(found[6], model.predict(own[6], actions, context)[6])


def test_the_module_predicts_the_same_and_passes_gradients(reg, rows):
    model, tensors = reg.model("servo_pendulum"), [torch.tensor(part) for part in rows]
    module = model.torch()
    np.testing.assert_allclose(module(*tensors).detach().numpy(), model.predict(*rows), rtol=0, atol=2e-5)
    alone = reg.model(model.entries[4]).torch()
    assert alone(*tensors).shape == tensors[0].shape
    tensors[1].requires_grad_()
    module(*tensors).sum().backward()
    assert tensors[1].grad.abs().sum() > 0 and all(p.grad is not None for p in module.parameters())
    assert {"input_mean", "delta_std", "usual"} <= {name for name, _ in module.named_buffers()}


def test_without_context_inputs_and_settings_are_nominal(reg, rows):
    model, (states, actions, _) = reg.model("servo_pendulum"), rows
    assert model.context == ("supply", "arm/enabled", "kp", "added_mass")
    np.testing.assert_array_equal(model.predict(states, actions), model.predict(states, actions, model.usual))
    tensors = torch.tensor(states), torch.tensor(actions)
    np.testing.assert_allclose(
        model.torch()(*tensors).detach().numpy(), model.predict(states, actions), atol=2e-5
    )


def test_what_does_not_fit_is_told(reg, rows):
    model, (states, actions, context) = reg.model("servo_pendulum"), rows
    with pytest.raises(UsageError, match="states of shape .*arm/position, arm/velocity"):
        model.predict(states[:, :1], actions, context)
    with pytest.raises(UsageError, match="actions of shape"):
        model.predict(states, actions, context, steps=2)
    with pytest.raises(UsageError, match="context of shape"):
        model.predict(states, actions, context[:, :2])
    with pytest.raises(UsageError, match="rows of actions"):
        model.predict(states, actions[:3], context)
    with pytest.raises(UsageError, match="inputs.*nan"):
        model.predict(states * np.nan, actions, context)
    with pytest.raises(UsageError, match="each once"):
        reg.model([model.entries[0], model.entries[0]])
