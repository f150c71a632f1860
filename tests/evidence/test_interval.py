"""Intervals: draws cut off at bounds, weights that suffice, a posterior that holds the truth."""

import numpy as np
import pytest
from by_hand import answered, first_channel, held_against_zero, plain
from scipy.signal import lfilter
from scipy.stats import norm, truncnorm

from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.evidence.fit import fit
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.interval import COMMON, ENOUGH, Posterior, Proposal, posterior
from dynreg.evidence.lockstep import Ask, run
from dynreg.evidence.point import Point, bounds
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def test_a_proposal_cut_at_a_bound_gives_the_quantiles_of_what_is_left():
    limits = np.array([[0.5, 9.0]])
    proposal = Proposal(np.zeros(1), np.eye(1), limits)
    z, inside = proposal.draw(np.random.default_rng(0), 4000)
    weights = np.exp(norm.logpdf(z[:, 0]) - proposal.log_density(z) + inside)
    assert weights.mean() == pytest.approx(norm.sf(0.5) - norm.sf(9.0), rel=0.02), "the share inside is right"
    told = Posterior(Hypothesis(), z, weights / weights.sum(), 1.0, 1.0).quantiles(z[:, 0])
    assert z.min() >= 0.5 and z.max() <= 9.0
    assert told == pytest.approx(truncnorm(0.5, 9.0).ppf([0.05, 0.95]), abs=0.08)


@pytest.fixture(scope="module")
def servo():
    """A servo with Coulomb friction of medium size: its model, all windows, the fitted point, and the true size."""
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (term("coulomb_friction"),), "medium", 3)
    recording = log_of(robot, hidden, protocol(robot, seed=2, seconds=12.5), engine="mujoco")
    model, data = pose(robot, recording, DiagnosisOptions(threads=1))
    found = run(calibrate(model, data, draws=0))
    start = Point(Hypothesis((term("coulomb_friction"),)), found.point.nominal, np.ones(1))
    (point,), _ = run(fit(found.model, [start], found.sample))
    return found.model, data.sample(data.parts.chosen), point, float(hidden.values[0][0])


def test_the_posterior_holds_the_truth_within_the_bounds(servo):
    model, sample, point, true = servo
    draws = run(posterior(model, point, sample))
    limits = bounds(model.coordinates, point.hypothesis)
    assert (draws.z >= limits[:, 0]).all() and (draws.z <= limits[:, 1]).all()
    values = model.coordinates.effect_values(point.hypothesis, draws.z[:, len(point.nominal) :])[0]
    low, high = draws.quantiles(values)
    assert low[0] <= true <= high[0]
    assert np.array_equal(run(posterior(model, point, sample)).weights, draws.weights)


def test_a_posterior_in_a_corner_of_its_bounds_is_still_told(servo):
    model, sample, point, _ = servo
    limits = bounds(model.coordinates, point.hypothesis)
    draws = run(posterior(model, point.moved(limits[:, 0]), sample))  # one draw in 2^8 lies inside
    assert np.isfinite(draws.z).all() and np.isfinite(draws.weights).all()
    assert (draws.z >= limits[:, 0]).all() and (draws.z <= limits[:, 1]).all()


def test_weights_that_few_draws_carry_are_flattened_until_enough_do():
    """A likelihood with a hole where its curvature was taken: proposals that follow it miss most of the rest."""
    model, data = held_against_zero("zero_offset", "resistance", "tip_mass", rows=400)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((1, 400))

    def answer(one: Ask) -> np.ndarray:
        z = model.coordinates.from_values(one.case.values)
        far = np.abs(z).sum(axis=1) > 1e-1  # near the point next to nothing changes: the prior alone is seen
        return first_channel(one, np.where(far, 0.3 * np.sum(z**2, axis=1), 0.0)[:, None, None] + noise)

    draws = answered(posterior(model, plain(0.0, 0.0, 0.0), data.sample(data.fit)), answer)
    assert 0 < draws.flat < 1 and draws.weights.sum() == pytest.approx(1.0)
    assert 1.0 / np.sum(draws.weights**2) == pytest.approx(ENOUGH, rel=0.05)


def test_pulls_of_one_rollout_are_one():
    """Intervals widen by what rollouts disagree in: parts that pull alike are no independent ones."""
    noise = np.random.default_rng(0).standard_normal((1, 4, 40))
    powers = {}
    for segments in (1, 2):
        model, data = held_against_zero("zero_offset", windows=4, fits=4, segments=segments)

        def answer(one: Ask, model=model) -> np.ndarray:
            z = model.coordinates.from_values(one.case.values)[:, 0]
            pulls = np.array([1.0, -1.0, 0.6, -0.6])[:, None]
            return first_channel(one, 0.1 * z[:, None, None] + pulls + 0.1 * noise)

        powers[segments] = answered(posterior(model, plain(0.0), data.sample(data.fit)), answer).power
    assert powers[1] < 0.5 and powers[2] == pytest.approx(powers[1], rel=0.2)


FREE = ("zero_offset", "resistance", "tip_mass", "torque_constant", "rotor_inertia")


def power_and_ranks(seed: int, alike: float, windows: int = 6, rows: int = 60) -> tuple[float, list[float]]:
    """Of a linear servo of five parameters, drawn from the nameplate: the power, and the ranks of the true ones.

    alike : correlation from row to row of the noise that a fit to its windows sees.
    """
    rng = np.random.default_rng(seed)
    model, data = held_against_zero(*FREE, windows=windows, fits=windows, rows=rows)
    slope = 0.02 * np.cumsum(rng.standard_normal((len(FREE), windows, rows)), axis=2) / np.sqrt(rows)
    noise = lfilter([np.sqrt(1.0 - alike**2)], [1.0, -alike], rng.standard_normal((windows, rows)))
    true = rng.standard_normal(len(FREE))

    def answer(one: Ask) -> np.ndarray:
        z = model.coordinates.from_values(one.case.values)
        return first_channel(one, np.tensordot(z - true, slope, 1) + 0.01 * noise)

    sample = data.sample(data.fit)
    for _ in range(3):
        (point,), _ = answered(fit(model, [plain(*np.zeros(len(FREE)))], sample), answer)
        sample = sample.reweighted(answered(model.residuals([point], sample), answer)[0])
    draws = answered(posterior(model, point, sample, seed=seed), answer)
    return draws.power, [float(draws.weights @ (draws.z[:, d] < z)) for d, z in enumerate(true)]


def test_ranks_of_true_parameters_are_uniform_or_in_the_middle_where_noise_stays_alike():
    """Simulation-based calibration (Talts et al. 2018): too narrow a posterior leaves the truth in its tails."""
    found = [power_and_ranks(seed, 0.9) for seed in range(24)]
    ranks = np.array([ranks for _, ranks in found])
    held = ((ranks > 0.05) & (ranks < 0.95)).mean()
    assert held >= 0.86, (
        "of 120 nominal 90 % intervals; 0.76 where pulls are held against what they were before a fit"
    )
    assert 0.4 < ranks.mean() < 0.6


def test_power_tells_what_rollouts_that_agree_may_still_have_in_common():
    powers = [power_and_ranks(seed, 0.0)[0] for seed in range(6)]
    assert max(powers) == pytest.approx(1.0 / (1.0 + COMMON)) and min(powers) > 0.3
