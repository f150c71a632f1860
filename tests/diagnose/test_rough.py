"""A leg that stands: its rollouts are found to be rough, and its last refit simulates the finer time step itself."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from dynreg.diagnose.evidence import remaining
from dynreg.diagnose.finish import POLISHED
from dynreg.diagnose.fit import objective, polish, uneven
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Point
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.robot import load_robot


@lru_cache
def posed(height: float):
    """A leg without effects over the rail's stop at `height` [m]: one second to fit, as much to select."""
    robot = load_robot("leg")
    plan = protocol(robot, seed=1, seconds=5.0, episode=1.0, reach=1.0)
    plan = replace(plan, run=replace(plan.run, settings=np.full_like(plan.run.settings, height)))
    hidden = hide(robot, (), None, 11)
    problem, split = pose(robot, log_of(robot, hidden, plan), DiagnosisOptions(hold_out="test_0", threads=1))
    return problem, np.flatnonzero(split.fit), problem.coordinates.from_values(hidden.parameters)


@pytest.mark.parametrize(("height", "rough"), [(0.5, False), (0.2, True)])
def test_rollouts_are_rough_where_the_foot_touches_the_ground(height, rough):
    problem, fit_on, _ = posed(height)
    nameplate = Point(Hypothesis(), np.zeros(len(problem.coordinates)), np.zeros(0))
    assert uneven(problem, nameplate, fit_on) is rough


def test_simulated_finely_the_true_parameters_leave_the_noise_on_the_ground_too():
    problem, fit_on, z = posed(0.2)
    truth = [Point(Hypothesis(), z, np.zeros(0))]
    rough = replace(problem, rough=True)
    coarse, fine = (p.residuals(truth, fit_on)[0] for p in (rough, rough.fine))
    left = [np.sqrt((r**2).mean(axis=(0, 1)) / problem.floor) for r in (coarse, fine)]
    assert (left[1] < 1.6).all() and (left[0] > 1.5 * left[1]).any()


def test_only_rough_rollouts_are_simulated_finely():
    problem, _, _ = posed(0.2)
    assert replace(problem, rough=False).fine.robot is problem.robot
    fine = replace(problem, rough=True).fine.robot
    assert fine.file.robot.timestep == problem.robot.file.robot.timestep / 8


def test_a_slip_in_one_window_does_not_hide_that_the_others_are_explained():
    slipped = np.full((6, 50), 0.01)
    slipped[3] = 0.1
    assert remaining(slipped, rough=False) > 4.0 * 0.01
    assert remaining(slipped, rough=True) < 1.5 * 0.01
    assert remaining(10.0 * slipped, rough=True) == pytest.approx(10.0 * remaining(slipped, rough=True))
    slipped[2] = np.nan
    assert remaining(slipped, rough=True) < 1.6 * 0.01


def test_polishing_comes_as_near_as_the_truth_and_never_does_worse():
    problem, fit_on, z = posed(0.2)
    problem.rough = True
    start = Point(Hypothesis(), z + np.where(np.arange(len(z)) % 2, 0.5, -0.5), np.zeros(0))
    truth = Point(Hypothesis(), z, np.zeros(0))
    (found,), _ = polish(problem, [start], fit_on, iterations=POLISHED)
    points = [start, found, truth]
    made = problem.fine.residuals(points, fit_on)
    cost = objective(problem, points, made, problem.effective(made[2]))
    assert cost[1] < cost[0]
    assert cost[1] - cost[2] < 0.3 * (cost[0] - cost[2])
