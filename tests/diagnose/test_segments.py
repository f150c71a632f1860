"""A floating base on its feet: each part of a rollout counts with a variance of its own."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from dynreg.diagnose.diagnose import pose
from dynreg.diagnose.evidence import Evidence
from dynreg.diagnose.fit import objective
from dynreg.diagnose.hypothesis import Hypothesis
from dynreg.diagnose.name import calibrate, select
from dynreg.diagnose.problem import Point
from dynreg.diagnose.settings import Settings
from dynreg.diagnose.truth import hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


@lru_cache
def posed():
    """A quadruped with a payload: the problem, its windows to fit and to select by, the hidden robot, the log."""
    robot = load_robot("quadruped")
    plan = protocol(robot, seed=1, seconds=4.0, episode=0.7, reach=0.3)
    hidden = hide(robot, (term("payload"),), "strong", 11)
    log = log_of(robot, hidden, plan)
    problem, split = pose(None, robot, log, Settings(threads=1))
    return problem, np.flatnonzero(split.fit), np.flatnonzero(split.select), hidden, log


def points(problem, hidden) -> list[Point]:
    z = problem.coordinates.from_values(hidden.parameters)
    return [
        Point(Hypothesis(), z, np.zeros(0)),
        Point(
            Hypothesis(hidden.terms), z, np.ones(1) * hidden.values[0][0] / hidden.terms[0].effect.size.medium
        ),
    ]


def test_segments_hold_all_of_a_rollout_and_share_its_samples():
    problem, fit_on, _, hidden, _ = posed()
    cut, whole = (
        p.residuals(points(problem, hidden), fit_on) for p in (problem, replace(problem, whole=True))
    )
    assert cut.shape[1] == problem.segments * len(fit_on) > whole.shape[1] == len(fit_on)
    joined = cut.reshape(2, len(fit_on), -1, cut.shape[-1])
    rows = whole.shape[2]
    assert np.array_equal(joined[:, :, :rows], whole, equal_nan=True)
    assert np.isnan(joined[:, :, rows:]).all() and joined.shape[2] < rows + problem.segments
    samples, known = problem.effective(cut[0]), replace(problem, whole=True).effective(whole[0])
    assert samples.shape == (cut.shape[1], cut.shape[-1])
    assert samples.reshape(len(fit_on), problem.segments, -1).sum(axis=1) == pytest.approx(known)


def test_only_a_robot_on_its_feet_has_segments():
    robot = load_robot("leg")
    log = log_of(robot, hide(robot, (), None, 11), protocol(robot, seed=1, seconds=5.0, episode=1.0))
    problem, _ = pose(None, robot, log, Settings(threads=1))
    assert replace(problem, rough=True).segments == 1 < posed()[0].segments


def test_what_comes_after_a_slip_does_not_drown_what_came_before():
    problem, fit_on, *_ = posed()
    made = np.full((2, len(fit_on), 60, len(problem.use)), 0.02)
    made[0, :, 40:], made[1, :, :40], made[1, :, 40:] = 1.0, 0.2, 0.9  # right until the slip; wrong all along
    alike, costs = [Point(Hypothesis(), np.zeros(len(problem.coordinates)), np.zeros(0))] * 2, []
    for one in (problem, replace(problem, whole=True)):
        residuals = one._in_segments(made)
        costs.append(objective(one, alike, residuals, np.full(residuals.shape[1:4:2], 10.0)))
    assert costs[0][0] < costs[0][1] and costs[1][0] > costs[1][1]


def test_the_true_cause_gains_on_the_windows_to_select_by_and_the_verdict_is_of_whole_rollouts():
    problem, fit_on, select_on, hidden, log = posed()
    plain, true = points(problem, hidden)
    naming = select(problem, plain, [true], fit_on, select_on)
    assert naming.chosen is not None and naming.chosen.key == "payload"
    assert len(naming.chosen.square) == problem.segments * (len(fit_on) + len(select_on))
    both = np.concatenate([fit_on, select_on])
    told = [Evidence.of(p, log, true, both).ratio for p in (problem, replace(problem, whole=True))]
    assert told[0] == told[1] < Evidence.of(problem, log, plain, both).ratio


def test_few_terms_are_calibrated_in_segments_too():
    problem, fit_on, *_ = posed()
    base, effective = calibrate(replace(problem, corrections={}), fit_on, iterations=1, draws=0)
    assert effective.shape == (problem.segments * len(fit_on), len(problem.use))
    assert np.isfinite(base.nominal).all()
