"""The MLP learns displacements; the validation part decides for how long it trains."""

import numpy as np

from dynreg.compare import mlp
from dynreg.compare.mlp import train_mlp
from dynreg.rng import stream
from dynreg.timed.commands import drawn
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import KHEPERA, unicycle

TRACK = 0.0884


def parts():
    commands = drawn(240, stream(1, "commands"), seconds=(0.1, 0.6))
    moved = unicycle(commands, KHEPERA, TRACK)
    return [(commands.take(c), moved[c]) for c in (slice(0, 160), slice(160, 200), slice(200, 240))]


def test_it_knows_the_lag_that_the_closed_form_does_not() -> None:
    known, unseen, (commands, moved) = parts()
    found = train_mlp(*known, unseen, threads=1)
    error = np.abs(found.predict(commands) - moved).mean(axis=0)
    assert (error < 0.6 * np.abs(kinematic(commands, TRACK) - moved).mean(axis=0)).all()
    scaled = (found.predict(unseen[0]) - unseen[1]) / found.out_scale
    assert np.isclose(found.error, (scaled**2).mean(), rtol=1e-4)


def test_what_the_validation_part_likes_best_is_kept(monkeypatch) -> None:
    """Its displacements are noise: the shortest training follows the others' the least."""
    monkeypatch.setattr(mlp, "EPOCHS", (1, 40))
    known, unseen, _ = parts()
    noise = stream(2, "noise").standard_normal(unseen[1].shape) * known[1].std(axis=0)
    assert train_mlp(*known, (unseen[0], -unseen[1] + noise), threads=1).epochs == 1
    assert train_mlp(*known, unseen, threads=1).epochs == 40


def test_seeds_matter_and_threads_do_not(monkeypatch) -> None:
    monkeypatch.setattr(mlp, "EPOCHS", (2,))
    known, unseen, _ = parts()
    one, two = (train_mlp(*known, unseen, threads=threads).stack for threads in (1, 2))
    other = train_mlp(*known, unseen, seed=1, threads=1).stack
    assert all(np.array_equal(a, b) for a, b in zip(one.weights, two.weights, strict=True))
    assert not np.array_equal(one.weights[0], other.weights[0])


def test_commands_that_all_last_the_same_can_be_learned(monkeypatch) -> None:
    monkeypatch.setattr(mlp, "EPOCHS", (2,))
    known, unseen, _ = parts()
    for commands, _moved in (known, unseen):
        commands.seconds[:] = 0.02
    found = train_mlp(*known, unseen, threads=1)
    assert found.scale[4] == 1.0 and np.isfinite(found.predict(unseen[0])).all()
