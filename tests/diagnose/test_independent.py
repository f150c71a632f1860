"""Trials of hidden robots by other code: what they hide, what is right for it, and a diagnosis of each sort."""

import shutil

import numpy as np
import pytest

from dynreg.diagnose.independent import hide_independent, independent_log
from dynreg.diagnose.threshold import USUAL, Threshold
from dynreg.diagnose.trial import Trial, Trials, joint_right, right_names
from dynreg.errors import UsageError
from dynreg.evidence.truth import protocol
from dynreg.results.trials import TrialTable
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.verbs.trial import TrialSettings, trial
from dynreg.verbs.trials import independent_jobs, results_of
from dynreg.verbs.verb import Built


@pytest.fixture(scope="module")
def servo():
    return load_robot("servo_pendulum")


def test_a_cause_of_the_librarys_physics_is_a_term_with_its_values(servo):
    hidden, truth = hide_independent(servo, "stribeck_friction", "medium", 5)
    assert [t.key for t in hidden.terms] == ["stribeck_friction"]
    names = [p.name for p in hidden.terms[0].effect.parameters]
    assert dict(zip(names, hidden.values[0], strict=True)) == pytest.approx(truth.values)
    assert (
        servo.space.as_dict(hidden.parameters) == truth.parameters != servo.space.as_dict(servo.space.nominal)
    )


def test_names_of_other_physics_are_any_of_several(servo):
    hidden, _ = hide_independent(servo, "dahl_friction", "medium", 5)
    assert not hidden.terms and hidden.id == "dahl_friction" and not hidden.outside
    assert right_names(servo, hidden) == [{"coulomb_friction", "stribeck_friction"}]


def test_what_has_no_name_lies_outside(servo):
    hidden, _ = hide_independent(servo, "friction_patch", "medium", 5)
    assert hidden.outside and hidden.anything and right_names(servo, hidden) == []


def test_a_cause_in_one_joint_is_right_there():
    arm = load_robot("two_joint_arm")
    hidden, truth = hide_independent(arm, "force_offset[elbow]", "medium", 5)
    assert truth.joints == hidden.joints == ("elbow",)
    assert joint_right(arm, hidden, term("force_offset[elbow]"))
    assert not joint_right(arm, hidden, term("force_offset[shoulder]"))
    whole, _ = hide_independent(arm, "payload", "medium", 5)
    assert whole.joints == () and joint_right(arm, whole, term("payload")) is None


def test_robots_without_a_truth_are_refused_with_those_that_have_one():
    with pytest.raises(UsageError, match="expected one of .*servo_pendulum.*diffdrive"):
        hide_independent(load_robot("leg"), None, None, 1)


def test_a_changed_robot_has_not_the_truth_of_the_one_whose_name_it_has(servo, tmp_path):
    folder = tmp_path / "servo_pendulum"
    shutil.copytree(servo.folder, folder)
    hide_independent(load_robot(folder), None, None, 1)  # a copy is the same robot
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    (folder / "robot.toml").write_text(text + "\n# heavier\n", encoding="utf-8")
    changed = load_robot(folder)
    with pytest.raises(UsageError, match="is not the one of that name that comes with dynreg"):
        hide_independent(changed, None, None, 1)
    asked = Built(None, changed)  # no registry: it is refused before the threshold
    with pytest.raises(UsageError, match="is not the one of that name that comes with dynreg"):
        trial(asked, TrialSettings(hide="nothing", truth="independent", threads=1))


def test_a_log_is_that_of_the_protocol(servo):
    plan = protocol(servo, seed=1, seconds=12.5)
    log = independent_log(servo, hide_independent(servo, None, None, 3)[1], plan)
    assert [e.name for e in log.episodes] == list(plan.names) and not log.measured
    assert log.episodes[0].settings == dict(zip(servo.settings, plan.run.settings[0], strict=True))
    assert log.names[: len(servo.channels)] == servo.channels
    first = log.episodes[0].values[0, 0]
    assert first == pytest.approx(plan.run.initial[0, 0], abs=0.004), "noise and a count"


def test_robots_that_hide_something_nothing_and_what_has_no_name_are_told_apart():
    base = load_robot("diffdrive")
    trials = Trials(base, protocol(base, seed=3, seconds=25.0), threads=1, truth="independent")
    todo = [
        Trial((), "strong", 11, cause="wheel_gain"),
        Trial((), None, 12),
        Trial((), "strong", 13, cause="eccentric_wheel"),
    ]
    named, nothing, outside = results_of(trials, todo, Threshold(USUAL, ()))
    assert named.right and named.named == "wheel_gain" and named.parameter_error < 0.1
    assert named.share_of_attainable_gain == pytest.approx(1.0, abs=0.1)
    assert (
        nothing.hidden is None and nothing.size is None and nothing.false_alarm == (nothing.named is not None)
    )
    assert outside.hidden == "eccentric_wheel" and outside.outside and outside.size == "strong"
    assert outside.right == (outside.verdict not in ("named", "ambiguous")) and outside.in_set is None
    table = TrialTable.of("diffdrive", [named, nothing, outside])
    assert (table.right.of, table.outside.of, table.not_none.of) == (1, 1, 1)
    assert table.not_none.hits == int(nothing.verdict != "none")


def test_a_right_name_that_explains_a_part_is_told_so(servo):
    """The truth's current lags without its back-EMF, the library's with it."""
    trials = Trials(servo, protocol(servo, seed=3, seconds=25.0), threads=1, truth="independent")
    (one,) = results_of(trials, [Trial((), "strong", 1488298518, cause="torque_lag")], Threshold(USUAL, ()))
    assert (one.named, one.verdict) == ("torque_lag", "partly_explained")
    assert one.in_part and not one.right and not one.wrong


def test_drawn_causes_are_those_of_the_physics_that_is_asked_for(servo):
    drawn = {
        p: {t.cause for t in independent_jobs(servo, "drawn", (), "weak", 40, 1, p)}
        for p in ("same", "other")
    }
    assert not drawn["same"] & drawn["other"] and "lugre_friction" in drawn["other"]
    every = independent_jobs(servo, "every", (), "weak", 2, 1, "same")
    assert len({t.seed for t in every}) == len(every) == 2 * len({t.cause for t in every})
    assert [t.cause for t in independent_jobs(servo, "nothing", (), "weak", 2, 1, "same")] == [None, None]
    with pytest.raises(UsageError, match="one cause"):
        independent_jobs(servo, "chosen", ("backlash", "payload"), "weak", 2, 1, "same")


def test_the_librarys_own_robots_have_no_other_physics():
    with pytest.raises(UsageError, match="'independent'"):
        TrialSettings(physics="other")
    with pytest.raises(UsageError, match="unknown effect"):
        TrialSettings(hide="chosen", effects=("lugre_friction",))
    TrialSettings(hide="chosen", effects=("lugre_friction",), truth="independent", physics="other")


def test_seeds_of_values_and_of_robots_are_apart(servo):
    """The same robot can hide any cause: its parameters depend on the seed alone."""
    first, other = (hide_independent(servo, c, "medium", 9)[0] for c in ("backlash", None))
    assert np.array_equal(first.parameters, other.parameters)


def test_a_cause_between_two_joints_is_named_right_by_their_pair():
    """The truth couples the last two joints; the library's effect has pairs of neighbours as its only places."""
    arm = load_robot("two_joint_arm")
    hidden, _ = hide_independent(arm, "cable_coupling", "medium", 3)
    assert right_names(arm, hidden) == [{f"cable_coupling[{','.join(arm.driven)}]"}] and not hidden.outside


def test_an_encoder_on_the_motor_is_a_right_name_where_it_sits_there():
    servo = load_robot("servo_pendulum")
    hidden, _ = hide_independent(servo, "motor_elasticity", "medium", 3)
    assert right_names(servo, hidden) == [{"motor_elasticity", "joint_elasticity"}]
