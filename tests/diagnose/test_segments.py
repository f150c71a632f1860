"""A floating base on its feet: each part of a rollout counts with a variance of its own."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from dynreg.diagnose import interval
from dynreg.diagnose.diagnose import search
from dynreg.diagnose.effort import Effort
from dynreg.diagnose.evidence import Evidence
from dynreg.diagnose.finish import standing
from dynreg.diagnose.fit import objective
from dynreg.evidence.hypothesis import Coordinates, Hypothesis, single_terms
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import SEGMENT, Point
from dynreg.diagnose.score import BEYOND, PER_PARAMETER, select
from dynreg.diagnose.trial import attainable_share
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.diagnose.zeros import rezeroed
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

SETTINGS = DiagnosisOptions(hold_out="test_0", threads=1, max_causes=2)
FREE = ("torque", "leg_mass")
LITTLE = Effort(draws=0, alone=1, rival=1)  # takes less time


@lru_cache
def posed():
    """A quadruped with a payload: the problem, its parts, the hidden robot, the log."""
    robot = load_robot("quadruped")
    plan = protocol(robot, seed=1, seconds=6.5, episode=1.25, reach=0.3)
    hidden = hide(robot, (term("payload"),), "strong", 11)
    log = log_of(robot, hidden, plan)
    problem, split = pose(robot, log, SETTINGS)
    known = hidden.parameters.copy()  # all but two, which takes less time
    known[[robot.space.names.index(name) for name in FREE]] = np.nan
    return replace(problem, coordinates=Coordinates(robot, known)), split, hidden, log


def points(problem, hidden) -> list[Point]:
    """The true robot without its payload, and with it."""
    c = problem.coordinates
    effect = c.effect_coordinates(hidden.terms[0], hidden.values[0])
    z = c.from_values(hidden.parameters)
    return [Point(Hypothesis(), z, np.zeros(0)), Point(Hypothesis(hidden.terms), z, effect)]


def test_segments_hold_all_of_a_rollout_and_share_its_samples():
    problem, split, hidden, _ = posed()
    fit_on = np.flatnonzero(split.fit)
    uncut = replace(problem, whole=True)
    cut, whole = (p.residuals(points(problem, hidden), fit_on) for p in (problem, uncut))
    assert cut.shape[1] == problem.segments * len(fit_on) > whole.shape[1] == len(fit_on)
    joined, rows = cut.reshape(2, len(fit_on), -1, cut.shape[-1]), whole.shape[2]
    assert np.array_equal(joined[:, :, :rows], whole, equal_nan=True)
    assert np.isnan(joined[:, :, rows:]).all() and joined.shape[2] < rows + problem.segments
    early, known = cut[0].copy(), whole[0].copy()
    early[1 :: problem.segments, :, 0], known[:, cut.shape[2] :, 0] = (
        np.nan,
        np.nan,
    )  # measured at first alone
    for one, other in ((cut[0], whole[0]), (early, known)):
        samples = problem.effective(one)
        assert samples.reshape(len(fit_on), -1, one.shape[-1]).sum(axis=1) == pytest.approx(
            uncut.effective(other)
        )
    assert (samples[1 :: problem.segments, 0] == 0).all() and (samples[:: problem.segments, 0] > 0).all()


def test_a_segment_is_as_long_wherever_rollouts_are_cut_and_only_feet_need_it():
    problem, _, _, log = posed()
    rows = problem.windows.measured.shape[1] - 1
    assert problem.segments == round(rows * problem.windows.period / SEGMENT) == 2
    short, _ = pose(problem.robot, log, replace(SETTINGS, horizon=0.5))
    assert short.segments == 1
    leg = load_robot("leg")
    made = log_of(leg, hide(leg, (), None, 11), protocol(leg, seed=1, seconds=6.5, episode=1.25))
    assert replace(pose(leg, made, DiagnosisOptions(threads=1))[0], rough=True).segments == 1


def test_what_comes_after_a_slip_does_not_drown_what_came_before():
    problem, split, *_ = posed()
    made = np.full((2, int(split.fit.sum()), 40, len(problem.use)), 0.02)
    made[0, :, 20:], made[1, :, :20], made[1, :, 20:] = 1.0, 0.2, 0.9  # right until the slip; wrong all along
    alike, costs = [Point(Hypothesis(), np.zeros(len(problem.coordinates)), np.zeros(0))] * 2, []
    for one in (problem, replace(problem, whole=True)):
        residuals = one._in_segments(made)
        _, windows, _, channels = residuals.shape
        costs.append(objective(one, alike, residuals, np.full((windows, channels), 10.0)))
    assert costs[0][0] < costs[0][1] and costs[1][0] > costs[1][1]


class Fitted:
    """A problem of two windows to fit and one to select by, in three segments; the payload helps on fit alone."""

    segments, floor = 3, np.full(1, 1e-6)

    def residuals(self, points, chosen):
        out = np.ones((len(points), 3, 3, 20, 1))
        for i, point in enumerate(points):
            out[i, :2] *= 0.1 if point.hypothesis.terms else 1.0
        return out.reshape(len(points), 9, 20, 1)

    def effective(self, residual):
        return np.full((9, 1), 20.0)


def test_what_a_cause_gains_on_fit_alone_counts_no_more_than_where_rollouts_are_whole():
    plain, fitted = (Point(Hypothesis(t), np.zeros(1), np.ones(len(t))) for t in ((), (term("payload"),)))
    (scored,) = select(Fitted(), plain, [fitted], np.arange(2), np.arange(2, 3)).ranking
    assert scored.nats == pytest.approx(BEYOND - PER_PARAMETER)


def test_fitted_on_all_windows_together_what_a_cause_gains_counts_wherever_it_does():
    plain, fitted = (Point(Hypothesis(t), np.zeros(1), np.ones(len(t))) for t in ((), (term("payload"),)))
    (scored,) = select(Fitted(), plain, [fitted], np.arange(2), np.arange(2, 3), together=True).ranking
    assert scored.nats == pytest.approx(6 * 0.5 * 20.0 * np.log(100.0) - PER_PARAMETER, abs=0.01)


def test_with_and_without_a_term_a_standing_robot_is_fitted_on_all_windows_from_where_either_ended():
    problem, split, hidden, _ = posed()
    fit_on, select_on = np.flatnonzero(split.fit), np.flatnonzero(split.select)
    _, true = points(problem, hidden)
    off = Point(Hypothesis(), true.nominal + 0.7, np.zeros(0))
    half = Point(true.hypothesis, true.nominal, 0.5 * true.effect)
    start, (found,) = standing(problem, off, [half], fit_on, select_on, LITTLE)
    assert start.hypothesis.key == "" and found.hypothesis.key == "payload"
    fine, every = problem.fine, np.concatenate([fit_on, select_on])
    tried = [off, Point(Hypothesis(), found.nominal, np.zeros(0)), start, half, found, true]
    made = fine.residuals(tried, every)
    cost = objective(problem, tried, made, problem.effective(made[-1]))
    # the model without the term started where that with it ended, too
    assert cost[2] < min(cost[0], cost[1])
    assert cost[4] < min(cost[2], cost[3])


def test_the_verdict_is_of_whole_rollouts():
    problem, split, hidden, log = posed()
    plain, true = points(problem, hidden)
    told = [
        Evidence.of(p, log, true, split.chosen).noise.ratio for p in (problem, replace(problem, whole=True))
    ]
    assert told[0] == told[1] < Evidence.of(problem, log, plain, split.chosen).noise.ratio


def test_zeros_are_of_whole_episodes():
    problem, split, hidden, _ = posed()
    channels = [
        c.model_copy(update={"zero": 0.02}) if "/position" in c.name else c
        for c in problem.robot.file.channels
    ]
    robot = replace(problem.robot, file=problem.robot.file.model_copy(update={"channels": channels}))
    initial = np.nan_to_num(problem.windows.run.initial)  # not only settled stances
    windows = replace(problem.windows, run=replace(problem.windows.run, initial=initial))
    found = rezeroed(replace(problem, robot=robot), windows, points(problem, hidden)[1], split.chosen)
    moved = found.measured - windows.measured
    assert np.abs(np.nan_to_num(moved)).max() < 0.1 and np.nanmax(np.abs(moved)) > 0


def test_pulls_of_one_rollout_are_one():
    """Intervals widen by what rollouts disagree in: parts that pull alike are no independent ones."""
    problem, *_ = posed()
    residual, slopes = np.ones((4, 20, len(problem.use))), np.ones((1, 4, 20, len(problem.use)))
    effective = np.full((4, len(problem.use)), 10.0)
    cut, apart = (
        interval._agreement(p, residual, slopes, effective, np.eye(1))
        for p in (problem, replace(problem, whole=True))
    )
    assert problem.segments == 2 and cut == pytest.approx(apart / 2)


def test_a_search_and_the_share_of_what_can_be_won_count_in_segments_too():
    problem, split, hidden, _ = posed()
    fresh = replace(problem, corrections={})
    found = search(fresh, [], split, SETTINGS, needed=5.0, effort=LITTLE)
    assert found.accepted == 0 and np.isfinite(found.base.nominal).all()
    plain, true = points(problem, hidden)
    assert attainable_share(fresh, split, hidden, replace(found, base=plain, extended=true)) > 0.5


def test_a_long_list_is_searched_finely_and_a_round_that_finds_no_more_is_not_lost():
    problem, split, *_ = posed()
    terms = single_terms(problem.robot, ("payload", "ground_friction"))
    fresh, long = replace(problem, corrections={}), replace(LITTLE, long=0)
    found = search(fresh, terms, split, SETTINGS, needed=30.0, effort=long)
    assert [t.key for t in found.extended.hypothesis.terms] == ["payload"]
    assert found.accepted == 1 and len(found.rounds) == 2
    assert found.extended is found.rounds[1].start.point
    # the round that finds no cause has refitted the model that it began with
    both = np.flatnonzero(split.fit | split.select)
    ends = [found.rounds[0].chosen.point, found.extended]
    made = found.problem.fine.residuals(ends, both)
    first, last = objective(problem, ends, made, problem.effective(made[1]))
    assert last <= first
    # what its own rollouts differ by with a finer time step is known, where it is less than chaos
    every = np.flatnonzero(split.fit | split.select)
    usual, fine = (p.residuals([found.extended], every) for p in (found.problem, found.problem.fine))
    assert np.nanmedian(np.abs(usual - fine)) < 1e-12
