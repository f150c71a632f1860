"""Intervals: draws cut off at bounds, weights that suffice, a posterior that holds the truth; who is a neighbour."""

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from dynreg.diagnose import interval
from dynreg.diagnose.apart import neighbours
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.diagnose import search
from dynreg.diagnose.estimate import estimates
from dynreg.diagnose.fit import bounds, fit
from dynreg.evidence.hypothesis import Hypothesis, single_terms
from dynreg.diagnose.interval import Posterior, Proposal, posterior
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Point
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def test_a_proposal_cut_at_a_bound_gives_the_quantiles_of_what_is_left():
    limits = np.array([[0.5, 9.0]])
    proposal = Proposal(np.zeros(1), np.eye(1), limits)
    z, inside = proposal.draw(np.random.default_rng(0), 4000)
    weights, flat = interval._weighted(norm.logpdf(z[:, 0]) - proposal.log_density(z) + inside)
    told = Posterior(Hypothesis(), z, weights, 1.0, flat).quantiles(z[:, 0])
    assert flat == 1.0 and z.min() >= 0.5
    assert told == pytest.approx(truncnorm(0.5, 9.0).ppf([0.05, 0.95]), abs=0.08)


def test_weights_that_few_draws_carry_are_flattened_until_enough_do():
    weights, flat = interval._weighted(-np.linspace(0.0, 3000.0, 500))
    assert 0 < flat < 1
    assert 1.0 / np.sum(weights**2) == pytest.approx(interval.ENOUGH, rel=0.05)


@pytest.fixture(scope="module")
def servo():
    """A servo with Coulomb friction of medium size: its problem, windows, and the fitted point."""
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (term("coulomb_friction"),), "medium", 3)
    recording = log_of(robot, hidden, protocol(robot, seed=2, seconds=25.0), engine="mujoco")
    problem, split = pose(robot, recording, DiagnosisOptions(threads=1))
    base, effective = calibrate(problem, split.chosen)
    start = Point(Hypothesis((term("coulomb_friction"),)), base.nominal, np.ones(1))
    (point,), _ = fit(problem, [start], split.chosen, effective)
    return problem, split.chosen, point, float(hidden.values[0][0])


def test_the_posterior_holds_the_truth_within_the_bounds(servo):
    problem, chosen, point, true = servo
    draws = posterior(problem, point, chosen)
    limits = bounds(problem, point)
    assert (draws.z >= limits[:, 0]).all() and (draws.z <= limits[:, 1]).all()
    values = problem.coordinates.effect_values(point.hypothesis, draws.z[:, len(point.nominal) :])[0]
    low, high = draws.quantiles(values)
    assert low[0] <= true <= high[0]
    assert np.array_equal(posterior(problem, point, chosen).weights, draws.weights)


def test_neighbours_are_declared_by_either_effect_and_not_of_the_same_group():
    robot = load_robot("simple_pendulum")
    terms = single_terms(robot)
    assert {"coulomb_friction", "drive_gain", "inertia"} <= {
        t.key for t in neighbours(robot, term("payload"), terms)
    }
    assert "payload" in {t.key for t in neighbours(robot, term("drive_gain"), terms)}
    assert not {"com_offset", "encoder_offset"} & {
        t.key for t in neighbours(robot, term("gravity_tilt"), terms)
    }


def test_neighbours_on_several_joints_are_not_the_effect_itself_nor_of_the_group_of_its_joint():
    robot = load_robot("leg")
    terms = single_terms(robot)
    tilt = {t.key for t in neighbours(robot, term("gravity_tilt"), terms)}
    assert {"encoder_offset[knee]", "encoder_offset[hip_pitch]", "com_offset"} <= tilt
    assert not {"gravity_tilt", "encoder_offset[hip_roll]"} & tilt
    assert "encoder_offset" not in {t.key for t in neighbours(robot, term("encoder_offset[knee]"), terms)}
    play = {t.key for t in neighbours(robot, term("backlash[knee]"), terms)}
    assert "joint_elasticity[knee]" in play
    assert not {"joint_elasticity[hip_roll]", "backlash", "backlash[knee]", "backlash[hip_roll]"} & play


def test_a_posterior_in_a_corner_of_its_bounds_is_still_told(servo):
    problem, chosen, point, _ = servo
    limits = bounds(problem, point)
    draws = posterior(problem, point.moved(limits[:, 0]), chosen)  # one draw in 2^8 lies inside
    assert np.isfinite(draws.z).all() and np.isfinite(draws.weights).all()
    assert (draws.z >= limits[:, 0]).all() and (draws.z <= limits[:, 1]).all()


@pytest.mark.parametrize("key", ["speed_limit", "command_delay"])
def test_what_takes_times_is_found_beyond_the_models_time_step(key):
    """The model's steps of 2.5 ms would put these off by more than their intervals are wide."""
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, (term(key),), "strong", 11)
    recording = log_of(robot, hidden, protocol(robot, seed=2, seconds=25.0), engine="mujoco")
    problem, split = pose(robot, recording, DiagnosisOptions(threads=1))
    found = search(problem, [term(key)], split, DiagnosisOptions(threads=1, max_causes=1), needed=1.0)
    draws = posterior(found.problem, found.extended, split.chosen)
    size = next(iter(estimates(found.problem, found.extended, 0, draws).values()))
    assert size.low <= hidden.values[0][0] <= size.high
    assert size.high - size.low < 0.1 * size.value
