"""Networks learn displacements from commands; training ends where the validation error rises."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.timed import networks
from dynreg.timed.commands import drawn
from dynreg.timed.kinematic import kinematic
from dynreg.timed.networks import _out, _slopes, train
from dynreg.timed.unicycle import KHEPERA, unicycle

TRACK = 0.0884


def parts(noise: float = 0.0):
    """200 commands to learn, 60 to validate, 60 to test; displacements with noise [m, rad] but for the last."""
    commands = drawn(320, stream(1, "commands"), seconds=(0.1, 1.0))
    moved = unicycle(commands, KHEPERA, TRACK)
    noisy = moved + noise * stream(1, "noise").standard_normal(moved.shape)
    cut = [slice(0, 200), slice(200, 260), slice(260, 320)]
    return [(commands.take(c), (moved if c is cut[2] else noisy)[c]) for c in cut]


def test_derivatives_are_those_of_the_output() -> None:
    rng = stream(2, "slopes")
    weights, inputs = rng.standard_normal(141), rng.standard_normal((4, 5))
    slopes = _slopes(weights, inputs)
    assert slopes.shape == (4, 141)
    for i in (0, 57, 110, 125, 140):
        move = 1e-6 * np.eye(141)[i]
        difference = (_out(weights + move, inputs)[0] - _out(weights - move, inputs)[0]) / 2e-6
        assert slopes[:, i] == pytest.approx(difference, abs=1e-7)


def test_networks_know_the_lag_that_the_closed_form_does_not(monkeypatch) -> None:
    monkeypatch.setattr(networks, "ITERATIONS", 60)
    known, unseen, (commands, moved) = parts()
    found = train(*known, unseen, starts=1)
    error = np.abs(found.predict(commands) - moved).mean(axis=0)
    assert (error < 0.6 * np.abs(kinematic(commands, TRACK) - moved).mean(axis=0)).all()
    assert found.weights.shape == (3, 141)


def test_training_ends_after_ten_rises_and_keeps_the_best_of_all_starts(monkeypatch) -> None:
    """150 noisy rows for 141 weights: the validation error rises soon."""
    known, unseen, _ = parts(noise=0.02)
    few = (known[0].take(slice(0, 150)), known[1][:150])
    steps = []
    monkeypatch.setattr(networks, "_slopes", lambda *a: steps.append(1) or _slopes(*a))
    found = train(*few, unseen, starts=2)
    assert len(steps) < 6 * 0.5 * networks.ITERATIONS
    scaled = (found.predict(unseen[0]) - unseen[1]) / found.out_scale
    assert found.errors == pytest.approx(
        (scaled**2).mean(axis=0)
    )  # the weights kept are those of the best error
    assert (found.errors <= train(*few, unseen, starts=1).errors).all()


def test_workers_change_nothing() -> None:
    known, unseen, _ = parts(noise=0.02)  # with which training soon ends
    few = (known[0].take(slice(0, 150)), known[1][:150])
    done = []
    alone, two = (
        train(*few, unseen, starts=2, workers=workers, progress=lambda *n: done.append(n))
        for workers in (0, 2)
    )
    assert np.allclose(two.weights, alone.weights, rtol=1e-6)  # MINPACK's last bits differ from run to run
    assert np.allclose(two.errors, alone.errors, rtol=1e-6)
    assert done == [(i, 6) for i in range(1, 7)] * 2


def test_fewer_commands_than_weights_are_refused() -> None:
    known, unseen, _ = parts()
    with pytest.raises(UsageError, match="140 commands to train networks of 141 weights"):
        train(known[0].take(slice(0, 140)), known[1][:140], unseen)
