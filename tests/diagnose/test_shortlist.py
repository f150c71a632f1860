"""Several joints: what the time step does is taken off, and a short list of terms still holds the right one."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from dynreg.diagnose import shortlist
from dynreg.diagnose.calibrate import calibrate
from dynreg.diagnose.effort import Effort
from dynreg.diagnose.fit import fit, objective, sensitivities
from dynreg.evidence.hypothesis import Hypothesis, single_terms
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Point
from dynreg.diagnose.shortlist import mirrored, roughly_from, shortlisted
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.results.trials import TrialResult, TrialTable
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

SOME = ("coulomb_friction", "torque_limit", "encoder_scale", "backlash", "payload")

QUICK = Effort(iterations=3)


@lru_cache
def posed(key: str | None):
    """A leg in the air that hides a strong effect, as a problem: one second to fit, as much to select."""
    robot = load_robot("leg")
    table = robot.file.excitation.model_copy(update={"kinds": ["levels", "chirp"]})
    lively = replace(robot, file=robot.file.model_copy(update={"excitation": table}))
    plan = protocol(lively, seed=1, seconds=5.0, episode=1.0, reach=1.0)
    hidden = hide(robot, () if key is None else (term(key),), "strong", 11)
    problem, split = pose(robot, log_of(robot, hidden, plan), DiagnosisOptions(hold_out="test_0", threads=1))
    return problem, np.flatnonzero(split.fit), hidden


def true_point(problem, hidden) -> Point:
    return Point(Hypothesis(), problem.coordinates.from_values(hidden.parameters), np.zeros(0))


def test_with_the_time_step_taken_off_the_true_parameters_leave_the_noise():
    problem, fit_on, hidden = posed(None)
    truth, noise = true_point(problem, hidden), np.sqrt(problem.floor)
    problem.corrections.clear()
    before = np.sqrt((problem.residuals([truth], fit_on)[0] ** 2).mean(axis=(0, 1)))
    problem.refine([truth], np.arange(len(problem.windows)))
    after = np.sqrt((problem.residuals([truth], fit_on)[0] ** 2).mean(axis=(0, 1)))
    problem.corrections.clear()
    assert (before > 1.3 * noise).all()
    assert (after < 1.2 * noise).all()


def test_a_term_without_a_correction_of_its_own_takes_that_of_what_it_extends():
    problem, fit_on, hidden = posed(None)
    truth = true_point(problem, hidden)
    extended = Point(Hypothesis((term("payload"),)), truth.nominal, np.array([1e-3]))
    problem.corrections.clear()
    plain = problem.residuals([truth, extended], fit_on)
    problem.refine([truth], np.arange(len(problem.windows)))
    refined = problem.residuals([truth, extended], fit_on)
    problem.corrections.clear()
    assert refined[1] - plain[1] == pytest.approx(refined[0] - plain[0])


@pytest.mark.parametrize("key", ["coulomb_friction[knee]", "torque_limit[hip_pitch]"])
def test_the_best_of_the_list_is_the_hidden_effect_in_its_joint(key):
    problem, fit_on, _ = posed(key)
    base, effective = calibrate(problem, fit_on, draws=0)
    terms = single_terms(problem.robot, SOME)
    found = shortlisted(problem, base, terms, fit_on, effective, effort=QUICK)
    assert found[0].hypothesis.key == key
    assert len({p.hypothesis.key for p in found}) == len(found) < len(terms)


def test_a_rough_list_tries_what_has_a_sign_with_the_other_one():
    probe = lambda key, effect: Point(Hypothesis((term(key),)), np.zeros(6), np.array(effect))  # noqa: E731
    assert mirrored(probe("coulomb_friction[knee]", [1.0])) == []
    (tilted,) = mirrored(probe("gravity_tilt", [1.0]))
    assert tilted.effect.tolist() == [-1.0]
    both = Point(Hypothesis((term("payload"), term("cogging[knee]"))), np.zeros(6), np.array([0.5, 1.0, 0.0]))
    (turned,) = mirrored(both)
    assert turned.effect.tolist() == [0.5, -1.0, 0.0]


@pytest.mark.parametrize("key", ["gravity_tilt", "payload"])
def test_a_rough_list_holds_the_hidden_effect_too(key):
    problem, fit_on, _ = posed(key)
    rough = replace(problem, rough=True, corrections={})
    base, effective = calibrate(rough, fit_on, draws=0)
    terms = single_terms(problem.robot, (*SOME, "gravity_tilt"))
    found = [p.hypothesis.key for p in shortlisted(rough, base, terms, fit_on, effective, effort=QUICK)]
    assert key in found[:3] and len(set(found)) == len(found)


class Jumping:
    """A problem of one channel in which a tilt helps at one sign alone, and is all of the error there."""

    floor = np.full(1, 1e-4)
    coordinates = SimpleNamespace(nominal_bounds=np.array([[-1.0, 1.0]]))  # of a parameter that does nothing

    def __init__(self, rough: bool):
        self.rough = rough
        t = np.linspace(0.0, 1.0, 40)
        self.error, self.other = (f(2 * np.pi * t)[None, :, None] for f in (np.sin, np.cos))

    def residuals(self, points, chosen):
        out = []
        for point in points:
            size, key = point.effect[-1], point.hypothesis.key
            straight = self.error * (1.0 - 0.05 * min(size, 2.0))
            tilted = self.error + size * self.other if size > 0 else self.error * (1.0 + max(size, -1.0))
            out.append(tilted if key == "gravity_tilt" else straight)
        return np.array(out)


@pytest.mark.parametrize("rough", [True, False])
def test_what_a_probe_reaches_with_the_other_sign_ranks_a_term_only_where_rollouts_are_rough(rough):
    problem = Jumping(rough)
    base = Point(Hypothesis(), np.zeros(1), np.zeros(0))
    terms = [term(f"coulomb_friction[{j}]") for j in ("knee", "hip_roll", "hip_pitch")] + [
        term("gravity_tilt")
    ]
    starts = shortlist._probed(
        problem, base, terms, np.arange(1), np.full((1, 1), 40.0), problem.error, np.zeros((1, 1, 40, 1))
    )
    keys = [own[0].hypothesis.key for own in starts]
    (tilts,) = [own for own in starts if own[0].hypothesis.key == "gravity_tilt"]
    assert sorted(keys) == sorted(t.key for t in terms)
    # the best by first order, then the best of the probes themselves
    assert keys.index("gravity_tilt") == (1 if rough else len(terms) - 1)
    assert any(p.effect[-1] == -1.0 for p in tilts) is rough


def test_what_is_far_behind_the_best_of_its_own_start_is_not_refitted():
    problem, fit_on, _ = posed("gravity_tilt")
    rough = replace(problem, rough=True, corrections={})
    base, effective = calibrate(rough, fit_on, draws=0)
    terms = single_terms(problem.robot, ("coulomb_friction", "gravity_tilt"))
    lists = {}
    for behind in (0.0, np.inf):
        lists[behind] = shortlisted(rough, base, terms, fit_on, effective, effort=Effort(behind=behind))
    assert 1 <= len(lists[0.0]) <= 2 < len(lists[np.inf])


def test_from_the_nameplate_the_best_terms_walk_on_before_they_are_judged():
    problem, fit_on, _ = posed("payload")
    rough = replace(problem, rough=True, corrections={})
    base, effective = calibrate(rough, fit_on, draws=0)
    nameplate = Point(Hypothesis(), np.zeros(len(base.nominal)), np.zeros(0))
    terms = single_terms(problem.robot, ("payload", "coulomb_friction"))
    begun, further = (roughly_from(rough, nameplate, terms, fit_on, effective, further=n) for n in (0, 3))
    fine = lambda found: [  # noqa: E731
        objective(rough, [p], rough.fine.residuals([p], fit_on), effective)[0] for _, p in found
    ]
    assert [cost for cost, _ in further] == pytest.approx(fine(further))
    assert min(fine(further)) < min(fine(begun)) - 10.0


def test_known_derivatives_lead_to_the_same_optimum():
    problem, fit_on, _ = posed("coulomb_friction[knee]")
    base, effective = calibrate(problem, fit_on, draws=0)
    point = Point(Hypothesis((term("coulomb_friction[knee]"),)), base.nominal, np.array([1.0]))
    slopes = sensitivities(problem, [base], fit_on)[1][0]
    (full,), cost = fit(problem, [point], fit_on, effective, iterations=6)
    (quick,), price = fit(problem, [point], fit_on, effective, iterations=6, leading=slopes)
    assert quick.effect[0] == pytest.approx(full.effect[0], rel=0.1)
    assert price[0] == pytest.approx(cost[0], abs=5.0)


def test_the_table_counts_joints_where_an_effect_sits_in_one():
    def one(joint_right):
        given = {
            "robot": "leg",
            "seed": 1,
            "hidden": "backlash",
            "named": "backlash[knee]",
            "verdict": "named",
        }
        return TrialResult(**given, right=True, joint_right=joint_right, false_alarm=False, seconds=1.0)

    table = TrialTable.of("leg", [one(True), one(False), one(None)])
    assert (table.joint_right.hits, table.joint_right.of) == (1, 2)


def test_the_time_steps_part_is_that_of_the_terms_in_any_order():
    problem, fit_on, hidden = posed(None)
    truth, terms = true_point(problem, hidden), (term("payload"), term("coulomb_friction"))
    one = Point(Hypothesis(terms), truth.nominal, np.ones(2))
    other = Point(Hypothesis(terms[::-1]), truth.nominal, np.ones(2))
    problem.corrections.clear()
    problem.refine([one], np.arange(len(problem.windows)))
    first, second = problem.residuals([one, other], fit_on)
    problem.corrections.clear()
    assert second == pytest.approx(first, abs=1e-9)
    assert np.abs(first - problem.residuals([one], fit_on)[0]).max() > 1e-3
