"""What speaks against calling a cause named, each reason alone; and the sentence that says so."""

from dataclasses import replace

import made_up_diagnosis
import numpy as np
import pytest
from test_verdict import evidence, named

from dynreg.diagnose.doubts import PULLED, Doubt, at_bounds, doubts, replaced
from dynreg.diagnose.judging import Judged, loosened
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.ranking.population import Ranking
from dynreg.diagnose.score import Naming, Scored
from dynreg.diagnose.verdict import verdict_of
from dynreg.evidence.hypothesis import Coordinates, Hypothesis
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.known import nominal_known
from dynreg.results import Doubt as Told
from dynreg.results import diagnosis_details, diagnosis_sentence
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

ROBOT = load_robot("servo_pendulum")
C = Coordinates(ROBOT, nominal_known(ROBOT))
FRICTION = Hypothesis((term("load_friction"),))
FREE = [ROBOT.space.parameters[i].name for i in C.free]


def judged(*errors: float, plain: float = 1.0, windows: int = 6) -> Judged:
    """Simulators with these errors in every window: initial, calibrated, unpenalised, and after each cause."""
    wobble = 1.0 + 0.01 * np.random.default_rng(0).standard_normal((len(errors), windows))
    each = np.array(errors)[:, None] * wobble
    nothing = np.zeros((len(errors), windows, 2, 1))
    numbers, ones = np.arange(windows), np.ones(1)
    plains = np.full(windows, plain)
    return Judged(numbers, numbers, True, nothing, each, each[:, :1], ones, ones, plains)


def state(nominal: dict[str, float] | None = None, effect: float = 1.0, before: float = 0.0) -> State:
    """One accepted load friction of a size [medium]; parameters [sigma], and how far the first was without it."""
    z = np.array([(nominal or {}).get(name, 0.0) for name in FREE])
    point = Point(FRICTION, z, np.array([effect]))
    was = Point(Hypothesis(), np.r_[before, np.zeros(len(z) - 1)], np.zeros(0))
    naming = Naming(Scored(was, 0.0), (), Scored(point, 60.0), ())
    sample = None  # nothing here looks at data
    return State(Model(ROBOT, C), sample, was, point, (naming,), 1)


def kinds(found: State, seen: Judged) -> list[tuple[str, str]]:
    return [(one.kind, one.of) for one in doubts(found, seen)]


FINE = judged(0.9, 0.5, 0.5, 0.3)


def test_a_sound_cause_raises_no_doubt():
    assert kinds(state(), FINE) == []
    assert doubts(replace(state({"tip_mass": 9.0}), accepted=0), judged(0.9, 0.5, 0.5)) == ()


def test_a_parameter_that_left_its_nameplate_is_a_doubt():
    assert kinds(state({"tip_mass": 0.9 * PULLED}), FINE) == []
    (one,) = doubts(state({"tip_mass": -1.5 * PULLED}), FINE)
    assert (one.kind, one.of, one.value) == ("pulled", "tip_mass", pytest.approx(-1.5 * PULLED))


def test_a_parameter_is_pulled_from_its_nameplate_wherever_the_search_began():
    """Its pull was counted from the start: 25 % more mass there, and 22 sigma of robot.toml were no doubt."""
    at = ROBOT.space.names.index("tip_mass")
    heavy = ROBOT.space.nominal * np.where(np.arange(len(ROBOT.space)) == at, 1.25, 1.0)
    own = FREE.index("tip_mass")
    for centre, tolerance in ((heavy, 1.0), (None, 5.0), (heavy, 5.0)):
        c = Coordinates(ROBOT, nominal_known(ROBOT), centre, tolerance)
        z = c.from_values(np.where(np.arange(len(heavy)) == at, 1.22, 1.0) * ROBOT.space.nominal)
        assert c.pulls(z)[own] == pytest.approx(22.0), "1 % is stated"
        found = replace(state(), model=Model(ROBOT, c))
        found = replace(found, current=replace(found.current, nominal=z))
        (one,) = doubts(found, FINE)
        assert (one.kind, one.of, one.value) == ("pulled", "tip_mass", pytest.approx(22.0))
    guess = Coordinates(ROBOT, nominal_known(ROBOT), None, 10.0)
    point = replace(state().current, nominal=guess.from_values(c.values(z)))
    assert doubts(replace(state(), model=Model(ROBOT, guess), current=point), FINE) == (), (
        "a guess may be wrong"
    )


def test_a_parameter_at_the_edge_of_its_range_is_a_doubt_but_not_at_nothing():
    edge = dict(zip(FREE, C.nominal_bounds[:, 1], strict=True))["zero_offset"]
    assert ("parameter_at_bound", "zero_offset") in kinds(state({"zero_offset": edge}), FINE)
    low = [i for i, p in enumerate(ROBOT.space.parameters) if p.low == 0.0]
    assert not low, "no parameter of this robot begins at 0"
    parameters = tuple(
        replace(p, low=0.0, scale="linear") if p.name == "coulomb_friction" else p
        for p in ROBOT.space.parameters
    )
    at_zero = replace(ROBOT, space=replace(ROBOT.space, parameters=parameters))
    c = Coordinates(at_zero, nominal_known(ROBOT))
    least = np.where(np.array(FREE) == "coulomb_friction", c.nominal_bounds[:, 0], 0.0)
    assert at_bounds(c, Point(FRICTION, least, np.ones(1))) == []
    most = np.where(np.array(FREE) == "coulomb_friction", c.nominal_bounds[:, 1], 0.0)
    assert at_bounds(c, Point(FRICTION, most, np.ones(1))) == [("coulomb_friction", pytest.approx(0.08))]


def test_a_size_at_its_bound_or_under_half_the_weak_one_is_a_doubt():
    friction = FRICTION.parameters[0]
    assert kinds(state(effect=friction.most / friction.medium), FINE) == [("size_at_bound", "load_friction")]
    (one,) = doubts(state(effect=0.4 * friction.weak / friction.medium), FINE)
    assert (one.kind, one.of, one.value) == ("small", "load_friction", pytest.approx(0.4))
    assert kinds(state(effect=0.6 * friction.weak / friction.medium), FINE) == []


def test_a_cause_that_raises_the_held_out_error_is_a_doubt():
    assert kinds(state(), judged(0.9, 0.5, 0.5, 0.51)) == [("no_gain", "load_friction")]
    assert kinds(state(), replace(judged(0.9, 0.5, 0.5, 0.51), tested=False)) == []


def test_a_gain_is_held_against_the_better_calibration():
    seen = judged(0.9, 0.5, 0.2, 0.3)
    assert kinds(state(), seen) == [("no_gain", "load_friction")]
    assert seen.of_cause(0).value == pytest.approx(1 - 0.3 / 0.2, abs=0.05)
    assert judged(0.9, 0.2, 0.5, 0.3).rival == Judged.CALIBRATED


def test_a_cause_that_parameters_stood_in_for_need_not_lower_the_error():
    stood_in = state(before=12.0)
    assert replaced(stood_in.rounds[0]) and not replaced(state().rounds[0])
    seen = judged(0.9, 0.5, 0.5, 0.5)
    seen.each[3] = seen.each[1] + [0.02, -0.01, 0.01, -0.015, 0.0, 0.0]
    seen.each[2] = seen.each[1]
    assert kinds(state(), seen) == [("no_gain", "load_friction")] and kinds(stood_in, seen) == []
    assert kinds(stood_in, judged(0.9, 0.5, 0.5, 0.6)) == [("no_gain", "load_friction")]


def test_a_simulator_that_errs_more_than_one_that_holds_still_is_a_doubt():
    assert kinds(state(), judged(9.0, 5.0, 5.0, 3.0)) == [("no_better", "")]
    assert kinds(replace(state(), accepted=0), judged(9.0, 5.0, 5.0, 3.0)) == [("no_better", "")], (
        "of no cause, too"
    )


def test_without_a_cause_the_calibrated_simulator_is_held_against_one_that_holds_still():
    """That without the prior was: it is left to nobody, and may do better or worse."""
    none = replace(state(), accepted=0)
    assert kinds(none, judged(9.0, 0.5, 5.0)) == []
    assert kinds(none, judged(9.0, 5.0, 0.5)) == [("no_better", "")]


def test_a_log_that_looks_like_no_known_cause_is_a_doubt_about_a_cause_alone():
    near, far = (Ranking((), np.zeros(0), 1.0, 0.1, resemblance) for resemblance in (0.99, 0.5))
    assert doubts(state(), FINE, near) == ()
    assert doubts(state(), FINE, far) == (Doubt("unlike", "", 0.5),)
    two = judged(0.9, 0.5, 0.5, 0.3, 0.2)
    many = replace(state(), rounds=2 * state().rounds, accepted=2)
    assert not [d for d in doubts(many, two, far) if d.kind == "unlike"], (
        "several causes look like none of them"
    )


def test_with_a_doubt_no_cause_is_named():
    rounds, leg = named("backlash[knee]"), load_robot("leg")
    assert verdict_of(leg, evidence(1.0), rounds, 1, ()) == "named"
    assert verdict_of(leg, evidence(1.0), rounds, 1, (Doubt("pulled", "mass", 7.0),)) == "partly_explained"
    assert verdict_of(leg, evidence(1.0), rounds, 0, ()) == "none"


@pytest.mark.parametrize(
    ("doubt", "said"),
    [
        (
            Told(kind="pulled", of="tip_mass", value=-7.3),
            "tip_mass would have to be 7.3 sigma from its value",
        ),
        (
            Told(kind="parameter_at_bound", of="resistance", value=8.0),
            "resistance ends at the edge of its range",
        ),
        (
            Told(kind="size_at_bound", of="load_friction[arm]", value=5.0),
            "the size of load_friction[arm] ends at",
        ),
        (Told(kind="small", of="load_friction[arm]", value=0.4), "ends at 40 % of the weak one"),
        (
            Told(kind="no_better", of="", value=1.3),
            "the simulator errs 1.3 times as much as joints that hold still or just",
        ),
    ],
)
def test_a_doubt_is_in_the_sentence(doubt, said):
    told = made_up_diagnosis.diagnosis("partly_explained")
    told = told.model_copy(update={"doubts": (doubt,)})
    sentence = diagnosis_sentence(told)
    assert (
        said in sentence
        and sentence.startswith("load_friction of arm explains part of the error of")
        and ", but " in sentence
    )
    explained = told.noise.model_copy(update={"ratio": 1.1, "limit": 1.7, "explained": True})
    sentence = diagnosis_sentence(told.model_copy(update={"noise": explained}))
    assert sentence.startswith("bench_monday points to load_friction of arm, but ") and said in sentence


def test_a_cause_that_raises_the_error_is_told_in_a_line_of_its_own():
    told = made_up_diagnosis.diagnosis("partly_explained")
    worse = told.causes[1].model_copy(
        update={"gain": told.causes[1].gain.model_copy(update={"value": -0.03})}
    )
    doubt = Told(kind="no_gain", of="command_delay", value=-0.03)
    told = told.model_copy(update={"causes": (told.causes[0], worse), "doubts": (doubt,)})
    assert "command_delay" not in diagnosis_sentence(told)
    assert any("command_delay" in line and "do not rely on it" in line for line in diagnosis_details(told))


def test_the_unpenalised_rival_is_fitted_with_derivatives_as_wide_as_the_others():
    """Ten times the tolerance: in these coordinates a tenth of the width is the same change of a parameter."""
    model = Model(ROBOT, C)
    wide = loosened(model)
    steps = [
        m.coordinates.values(m.accuracy.nominal * np.eye(len(C)))[np.arange(len(C)), C.free]
        - C.centre[C.free]
        for m in (model, wide)
    ]
    stated = np.isfinite([ROBOT.space.parameters[i].tolerance for i in C.free])
    assert steps[1][stated] == pytest.approx(steps[0][stated], rel=0.1)
    assert wide.accuracy.width == model.accuracy.width, "sizes of effects keep their coordinates"


def test_a_cause_that_does_worse_than_the_better_calibration_is_told_by_that_gain():
    """It errs less than the calibrated simulator by 40 %, and by half more than the unpenalised one."""
    (one,) = doubts(state(), judged(0.9, 0.5, 0.2, 0.3))
    assert one.kind == "no_gain" and one.value == pytest.approx(-0.5, abs=0.05)


def test_a_size_that_a_simpler_effect_has_too_makes_no_cause_large():
    """Asymmetric friction without a difference is dry friction, however much of it there is."""
    lopsided = Hypothesis((term("asymmetric_friction"),))
    sizes = np.array([3.0 if p.shared else 1e-3 for p in lopsided.parameters])
    point = Point(lopsided, np.zeros(len(FREE)), sizes)
    naming = Naming(Scored(state().base, 0.0), (), Scored(point, 60.0), ())
    (one,) = doubts(replace(state(), current=point, rounds=(naming,)), FINE)
    assert one.kind == "small" and one.value < 0.01


def test_windows_of_an_episode_count_once_where_a_cause_raises_the_error():
    """One of four episodes in which it errs more, in all five of its windows, is no clear loss."""
    some = judged(0.9, 0.5, 0.5, 0.5, windows=20)
    more = np.where(np.arange(20) < 5, 1.4, 1.0 + 0.02 * np.sin(np.arange(20)))
    each = np.concatenate([some.each[:3], some.each[2:3] * more])
    runs = replace(some, each=each, episode=np.arange(20) // 5)
    assert not runs.clearly_worse(0) and runs.of_cause(0).value < 0.0
    assert replace(runs, episode=np.arange(20)).clearly_worse(0)
