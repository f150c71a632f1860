"""A planted dependence is found under its own name, and noise, however slow, is not."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.diagnose.residual_fit import Residuals, fit_residual
from dynreg.errors import UsageError

EPISODES, ROWS = 12, 100


def joint(seed: int = 0, episodes: int = EPISODES, rows: int = ROWS) -> Residuals:
    """A joint that swings as commanded, with measured signals; its residuals are zero until planted."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows) * 0.01
    phase = rng.uniform(0, 6, (episodes, 1, 3))
    rate = rng.uniform(2, 12, (episodes, 1, 3))
    size = rng.uniform(0.1, 0.5, (episodes, 1, 3))
    wave = rate * t[:, None] + phase
    q, v = (size * np.sin(wave)).sum(-1), (size * rate * np.cos(wave)).sum(-1)
    command = np.roll(q, -5, axis=1) + 0.05 * rng.standard_normal((episodes, 1))
    signals = {
        "position": q,
        "velocity": v,
        "sign_of_velocity": np.sign(v),
        "load": 3.0 * (command - q),
        "command": command,
        "time": t + 2.0 * np.arange(episodes)[:, None],
        "supply": 7.4 + 0.1 * rng.standard_normal(q.shape),
    }
    flat = {name: s.reshape(-1) for name, s in signals.items()}
    return Residuals("arm", "rad/s^2", np.zeros(q.size), flat, np.repeat(np.arange(episodes), rows))


def slow_noise(like: Residuals, seed: int, keep: float = 0.97) -> np.ndarray:
    """Noise of unit size whose memory is 1 / (1 - keep) rows, started anew in every trajectory."""
    rng = np.random.default_rng(seed)
    out = rng.standard_normal(len(like.values))
    for i in range(1, len(out)):
        if like.trajectory[i] == like.trajectory[i - 1]:
            out[i] = keep * out[i - 1] + np.sqrt(1 - keep**2) * out[i]
    return out


def planted(values, seed: int = 0, noise: float = 0.5, **kwargs) -> Residuals:
    """The joint with `values(signals)` of unit size and white noise."""
    base = joint(seed, **kwargs)
    signal = values(base.signals)
    rng = np.random.default_rng(seed + 100)
    return replace(
        base, values=(signal - signal.mean()) / signal.std() + noise * rng.standard_normal(len(signal))
    )


PLANTED = {
    "drag": (lambda s: s["velocity"] * np.abs(s["velocity"]), "velocity"),
    "viscous": (lambda s: s["velocity"], "velocity"),
    "coulomb": (lambda s: np.sign(s["velocity"]), "sign_of_velocity"),
    "cogging": (lambda s: np.cos(8 * s["position"]), "position"),
    "drift": (lambda s: s["time"], "time"),
    "sag": (lambda s: s["supply"] - 7.4, "supply"),
}


@pytest.mark.parametrize(("values", "signal"), PLANTED.values(), ids=PLANTED)
def test_what_was_planted_is_found_and_nothing_else(values, signal):
    found = fit_residual(planted(values))
    possible = 1 / 1.25
    assert 0.75 * possible < found.explained < possible + 0.05
    assert [r.signal for r in found.rows if r.share > 0] == [signal]
    assert found.rows[0].share == pytest.approx(found.explained, abs=0.05)


def test_two_causes_share_the_variance_as_they_were_planted():
    base = joint()
    v, u = base.signals["velocity"], base.signals["supply"] - 7.4
    values = 2.0 * v / v.std() + u / u.std() + 0.5 * np.random.default_rng(1).standard_normal(len(v))
    found = fit_residual(replace(base, values=values))
    share = {r.signal: r.share for r in found.rows if r.share > 0}
    assert share == {
        "velocity": pytest.approx(4 / 5.25, abs=0.05),
        "supply": pytest.approx(1 / 5.25, abs=0.05),
    }


def test_what_acts_only_together_is_shared_between_the_two():
    def both(s):
        return np.sign(s["position"]) * np.sign(s["supply"] - 7.4)

    found = fit_residual(planted(both, noise=0.3))
    share = {r.signal: r.share for r in found.rows if r.share > 0.02}
    assert set(share) == {"position", "supply"}
    assert share["position"] == pytest.approx(share["supply"], abs=0.05)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("keep", [0.0, 0.97])
def test_noise_says_nothing(seed, keep):
    base = joint(seed)
    found = fit_residual(replace(base, values=slow_noise(base, seed, keep)))
    assert found.explained == 0 and all(r.share == 0 for r in found.rows)
    assert {r.signal for r in found.rows} == set(base.signals)


@pytest.mark.parametrize("episodes", [1, 2])
def test_few_trajectories_are_cut_into_blocks(episodes):
    noise = joint(3, episodes=episodes, rows=1200)
    assert fit_residual(replace(noise, values=slow_noise(noise, 3))).explained == 0
    found = fit_residual(planted(lambda s: s["velocity"], seed=3, episodes=episodes, rows=800))
    assert found.rows[0].signal == "velocity" and found.rows[0].share > 0.6


def test_an_offset_of_each_trajectory_is_no_dependence():
    base = joint(5, episodes=20)
    offsets = np.random.default_rng(5).standard_normal(20)
    assert fit_residual(replace(base, values=offsets[base.trajectory])).explained == 0


def test_what_was_not_measured_is_left_out_and_poisons_nothing():
    whole = planted(lambda s: s["velocity"])
    values, supply = whole.values.copy(), whole.signals["supply"].copy()
    values[::7] = np.nan
    supply[::3] = np.nan
    supply[whole.trajectory < 9] = np.nan  # in some folds never seen
    signals = whole.signals | {
        "supply": supply,
        "temperature": np.full(len(values), np.nan),
        "kp": values * 0 + 4,
    }
    found = fit_residual(replace(whole, values=values, signals=signals))
    assert found.samples == np.isfinite(values).sum()
    assert [r.signal for r in found.rows if r.share > 0] == ["velocity"]
    assert all(np.isfinite(r.share) for r in found.rows)


def test_a_few_wild_samples_hide_nothing():
    whole = planted(lambda s: s["velocity"])
    values = whole.values.copy()
    values[::997] = 1e6
    assert fit_residual(replace(whole, values=values)).rows[0].signal == "velocity"


def test_too_few_samples_say_nothing():
    whole = planted(lambda s: s["velocity"], noise=0.0)
    short = Residuals(
        "arm", "rad/s^2", whole.values[:40], {"velocity": whole.signals["velocity"][:40]}, np.zeros(40)
    )
    nothing = Residuals("arm", "rad/s^2", np.full(40, np.nan), short.signals, short.trajectory)
    assert fit_residual(short).explained == fit_residual(nothing).explained == 0
    assert fit_residual(nothing).samples == 0


def test_the_same_residuals_give_the_same_answer():
    whole = planted(lambda s: s["velocity"] ** 3)
    few = {name: whole.signals[name] for name in ("velocity", "position")}
    whole = replace(whole, signals=few)
    assert fit_residual(whole, seed=4) == fit_residual(whole, seed=4)


def test_signals_of_another_length_are_refused():
    with pytest.raises(UsageError, match="'velocity' of joint 'arm' has shape"):
        Residuals("arm", "rad/s^2", np.zeros(5), {"velocity": np.zeros(4)}, np.zeros(5))
