"""The four verdicts: what is left against what cannot be explained, and whether a rival is as good."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.diagnose.score import Naming, Scored, chosen
from dynreg.diagnose.verdict import (
    EXPLAINED,
    Evidence,
    Left,
    Noise,
    group_of,
    most_left,
    noise_of,
    not_told_apart,
    remaining,
    rivals,
    verdict_of,
    worst,
)
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.point import Point
from dynreg.replay.repeatability import Repeatability
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def scored(*keys: str) -> Scored:
    terms = tuple(term(k) for k in keys)
    z = np.ones(sum(len(t.effect.parameters) for t in terms))
    return Scored(Point(Hypothesis(terms), np.zeros(1), z), 50.0)


def named(cause: str, *equivalent: str) -> tuple[Naming, ...]:
    return (Naming(scored(), [], scored(cause), [scored(e) for e in equivalent]),)


def evidence(ratio: float, basis: str = "repeatability", white: bool | None = False) -> Evidence:
    noise = Noise(
        channel="knee/position", unit="rad", left=ratio, floor=1.0, basis=basis, ratio=ratio, white=white
    )
    return Evidence(noise, {})


@pytest.mark.parametrize(
    ("ratio", "rounds", "accepted", "verdict"),
    [
        (1.0, named("backlash[knee]"), 1, "named"),
        (1.0, named("backlash[knee]", "inertia[knee]"), 1, "ambiguous"),
        (1.0, named("gravity_tilt", "encoder_offset[hip_roll]"), 1, "named"),
        (1.0, named("gravity_tilt", "encoder_offset[knee]"), 1, "ambiguous"),
        (2.0 * EXPLAINED, named("backlash[knee]"), 1, "partly_explained"),
        (1.0, named("backlash[knee]"), 0, "none"),
        (2.0 * EXPLAINED, named("backlash[knee]"), 0, "unknown"),
    ],
)
def test_a_verdict_is_what_is_left_and_who_else_explains_it(ratio, rounds, accepted, verdict):
    assert verdict_of(load_robot("leg"), evidence(ratio), rounds, accepted) == verdict


def test_without_repeated_runs_a_white_rest_counts_as_explained():
    far = 3.0 * EXPLAINED
    leg, rounds = load_robot("leg"), named("backlash[knee]")
    assert verdict_of(leg, evidence(far, "stated_noise", True), rounds, 1) == "named"
    assert verdict_of(leg, evidence(far, "stated_noise", False), rounds, 1) == "partly_explained"
    assert verdict_of(leg, evidence(far, "repeatability", True), rounds, 1) == "partly_explained"


def test_white_noise_on_one_channel_does_not_explain_another():
    """That furthest over its limit alone was asked: white there, an error on the other one passed for explained."""
    white, other = (
        evidence(times * EXPLAINED, "stated_noise", white).noise
        for times, white in ((3.0, True), (2.9, False))
    )
    assert worst([white, other]) is worst([other, white]) is other
    assert not Evidence(worst([white, other]), {}).explained
    both = [white, replace(other, white=True)]
    assert worst(both) is white and Evidence(worst(both), {}).explained


def test_rivals_leave_the_exact_group_out():
    (naming,) = named(
        "force_offset[knee]", "asymmetric_friction[knee]", "asymmetric_friction", "cogging[knee]"
    )
    assert rivals(load_robot("leg"), naming) == ["asymmetric_friction", "cogging[knee]"]


def test_a_cause_is_told_with_its_whole_exact_group_whatever_that_scored():
    """A late logger was told as commands that arrive late, as if certain, where a diagnosis asked for these alone."""
    servo, leg = load_robot("servo_pendulum"), load_robot("leg")
    assert group_of(servo, term("command_delay")) == ["sensor_delay"]
    assert group_of(servo, term("command_delay"), ["sensor_delay"]) == []
    assert group_of(leg, term("force_offset[knee]")) == ["asymmetric_friction[knee]"]
    assert group_of(leg, term("backlash[knee]")) == []


def ranked(needed: float, /, **nats: float) -> Naming:
    """A round of causes with so many nats, the first chosen; those within 15 nats are equivalent."""
    every = tuple(replace(scored(key), nats=score) for key, score in nats.items())
    return replace(chosen(scored(), every), needed=needed)


@pytest.mark.parametrize(
    ("naming", "rival", "untold"),
    [
        (ranked(5.0, load_friction=14.0, backlash=13.0), ["backlash"], ["backlash"]),
        (ranked(5.0, load_friction=14.0, backlash=4.0, payload=-0.1), [], []),
        (ranked(5.0, command_delay=457.0, sensor_delay=64.0), [], []),
        (ranked(5.0, command_delay=457.0, sensor_delay=450.0), [], ["sensor_delay"]),
        (ranked(5.0, command_delay=457.0), [], ["sensor_delay"]),
        (ranked(5.0, command_delay=14.0, sensor_delay=-0.1), [], []),
    ],
    ids=["as good", "by chance", "a part", "of its group", "not looked for", "nothing"],
)
def test_only_what_the_data_do_not_tell_from_a_cause_explains_it_as_well(naming, rival, untold):
    servo = load_robot("servo_pendulum")
    assert rivals(servo, naming) == rival and not_told_apart(servo, naming) == untold
    verdict = "ambiguous" if rival else "named"
    assert verdict_of(servo, evidence(1.0), (naming,), 1) == verdict


def test_a_slip_in_one_window_does_not_hide_that_the_others_are_explained():
    slipped = np.full((6, 50), 0.01)
    slipped[3] = 0.1
    assert remaining(slipped, rough=False) > 4.0 * 0.01
    assert remaining(slipped, rough=True) < 1.5 * 0.01
    assert remaining(10.0 * slipped, rough=True) == pytest.approx(10.0 * remaining(slipped, rough=True))
    slipped[2] = np.nan
    assert remaining(slipped, rough=True) < 1.6 * 0.01


def repeats(spread: float | None, independent: float = 0.0) -> Repeatability:
    return Repeatability("arm/position", "rad", spread, 0.001, 2, 500, independent)


def left(size: float, samples: float) -> Left:
    return Left(column=0, size=size, stated=0.001, samples=samples, white=False)


def test_the_limit_allows_for_the_sampling_error_of_residual_and_floor():
    """A ratio of 1.7 by five samples on either side is chance; by five hundred it is an error."""
    servo = load_robot("servo_pendulum")
    few, many = (noise_of(servo, left(0.0017, n), repeats(0.001, n), 1) for n in (5.0, 500.0))
    assert few.ratio == many.ratio == pytest.approx(1.7)
    assert Evidence(few, {}).explained and not Evidence(many, {}).explained
    assert many.limit == pytest.approx(EXPLAINED, rel=0.1) and few.limit > 2.0 * EXPLAINED
    by_noise = noise_of(servo, left(0.0017, 5.0), repeats(None), 1)
    assert by_noise.basis == "stated_noise" and EXPLAINED < by_noise.limit < few.limit, (
        "stated, it has no error"
    )
    assert noise_of(servo, left(0.0017, 5.0), repeats(0.001, 5.0), 6).limit > few.limit, (
        "of six, one may be large"
    )


def test_what_robots_without_an_effect_leave_as_well_is_explained():
    noise = evidence(3.0 * EXPLAINED).noise
    for usual, explained in ((True, True), (False, False), (None, False)):
        assert Evidence(noise, {}, usual).explained is explained
    assert most_left([left(0.002, 9.0), left(0.003, 9.0)]) == pytest.approx(3.0)


def test_without_any_noise_stated_no_ratio_is_told():
    """An error of a milliradian was said to be 1,000,000,000 times the stated noise."""
    servo = load_robot("servo_pendulum")
    found = noise_of(servo, replace(left(0.001, 500.0), stated=0.0), repeats(None), 1)
    assert found.ratio is None and found.floor == 0.0 and not found.explained
    assert replace(found, white=True).explained, "white noise is explained, however large"
    known = noise_of(servo, left(0.1, 500.0), repeats(None), 1)
    assert worst([found, known]) is known
    assert noise_of(servo, left(0.001, 500.0), repeats(0.001, 500.0), 1).ratio == pytest.approx(1.0)
