"""The alarm is raised by robots that no simulator of the family is like, and not by those of the family."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import secret_servo

import dynreg.sim.real as real
from dynreg.data.recording import Recording
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.neighbours.judge import LEAST, SURE, Judgement, _limit
from dynreg.replay.judged import gain
from dynreg.report.neighbours import next_steps, refusal, verdict
from dynreg.rng import stream
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.verbs.neighbours import _alarm


def tilted(degrees: float):
    angle = np.deg2rad(degrees)

    def tilt(model: mujoco.MjModel) -> None:
        model.opt.gravity[:] = 9.80665 * np.array([np.sin(angle), 0.0, -np.cos(angle)])

    return tilt


def ask(servos, seed: int, alter=None, **planted: float):
    recording = secret_servo.record(secret_servo.values_of(seed, **planted), seed, alter=alter)
    return servos.query(servos.ingest(recording, "servo_pendulum"))


def log(seed: int, *terms: str, seconds: float = 25.0) -> Recording:
    """A log of a servo that hides these effects at their strong size; half of its commands come twice."""
    robot = load_robot("servo_pendulum")
    hidden = hide(robot, tuple(term(key) for key in terms), "strong", seed)
    return log_of(robot, hidden, protocol(robot, seed=seed, seconds=seconds), engine="mujoco")


def without_repeats(recording: Recording) -> Recording:
    """The log with the commands of no two episodes alike."""
    return replace(
        recording, episodes=tuple(e for e in recording.episodes if not e.name.startswith("select"))
    )


def test_a_hidden_delay_of_20_ms_raises_the_alarm(servos):
    answer = servos.query(servos.ingest(log(3, "command_delay"), "servo_pendulum"))
    assert not answer.fits and answer.misfit > 5 * answer.misfit_limit
    assert f"above the limit of {answer.misfit_limit:.2g}" in answer.alarm
    assert "dynreg diagnose" in next_steps(answer)[0] and "dynreg diagnose" in refusal(answer).do


@pytest.mark.parametrize("seed", range(3, 7))
def test_a_servo_with_disturbed_drives_and_noise_raises_none(servos, seed):
    answer = servos.query(servos.ingest(log(seed), "servo_pendulum"))
    assert answer.fits and answer.alarm is None
    assert 0.5 < answer.misfit < 1.3 and answer.misfit_limit >= LEAST - 1e-9


def test_what_the_robot_does_not_repeat_raises_no_alarm(servos, monkeypatch):
    """Drives four times as unsteady as those of twins: known where commands come twice, else a cause."""
    monkeypatch.setattr(real, "DISTURBANCE", 4 * real.DISTURBANCE)
    recording = log(3, seconds=40.0)
    monkeypatch.undo()
    answer = servos.query(servos.ingest(recording, "servo_pendulum"))
    assert answer.fits and any("runs with the same commands differ" in note for note in answer.notes)
    once = servos.query(servos.ingest(without_repeats(recording), "servo_pendulum"))
    assert not once.fits and once.misfit > 1.5 * answer.misfit


def test_an_answer_that_was_not_sharpened_is_held_against_the_same_noise(servos):
    """A coarse answer to a servo of the family is not close; a search for a better one is named, and finds one."""
    recording = servos.ingest(log(3), "servo_pendulum")
    coarse, found = servos.query(recording, synthesise=False), servos.query(recording)
    assert found.fits and found.sharpened and not found.far
    assert coarse.stages[-1].fit > found.stages[-1].fit
    assert not coarse.fits and coarse.far and coarse.misfit > found.misfit
    assert "another simulator may fit" in coarse.alarm and "use" not in verdict(coarse)
    assert "dynreg query" in next_steps(coarse)[0] and "dynreg query" in refusal(coarse).do


def test_what_the_usual_query_refuses_is_never_to_be_used_without_a_search(servos):
    tilt = secret_servo.record(secret_servo.values_of(80), 80, alter=tilted(180))
    recording = servos.ingest(tilt, "servo_pendulum")
    for limits in ({}, {"synthesise": False}, {"budget": 20}):
        assert not servos.query(recording, **limits).fits


def test_without_replays_it_is_not_known_whether_the_nearest_is_close(servos):
    answer = servos.query(servos.ingest(log(3), "servo_pendulum"), synthesise=False, replay=False)
    assert answer.misfit is None and answer.fits is None and refusal(answer) is None
    assert any("See whether it is close" in step for step in next_steps(answer))
    for said in (verdict(answer), str(answer)):
        assert "not known whether it is close" in said and "use" not in said


@pytest.mark.parametrize("many", [2, 4, 8])
def test_one_more_robot_stays_below_the_limit_as_often_as_it_says(many):
    draws = np.exp(0.3 * stream(0, "limit").standard_normal((4000, many + 1)))
    below = np.mean([one[-1] <= _limit(one[:-1]) for one in draws])
    assert below == pytest.approx(SURE, abs=0.006)


@pytest.mark.parametrize(
    ("promised", "fits", "ended"), [(1.0, False, True), (0.98, False, True), (0.6, True, False)]
)
def test_an_error_that_the_search_left_raises_no_alarm(promised, fits, ended):
    about = {"usual": 0.01, "limit": 0.015, "unsteady": 1.0, "repeats": 0, "sharpened": True}
    judged = Judgement(error=0.03, promised=promised, **about)
    assert (judged.fits, judged.ended) == (fits, ended)
    assert judged.misfit == pytest.approx(3.0) and judged.misfit_limit == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("entries", "says"),
    [(2, "has 2 simulators, too few to make another"), (3, "--no-synthesise, or a small")],
)
def test_an_alarm_says_why_no_search_was_made(entries, says):
    about = {"usual": 0.01, "limit": 0.015, "unsteady": 1.0, "repeats": 0, "sharpened": False}
    alarm, _ = _alarm(Judgement(error=0.03, promised=1.0, **about), entries)
    assert says in alarm


def test_one_robot_tells_no_limit():
    assert _limit(np.array([0.1])) == np.inf


def test_servos_of_the_family_raise_no_alarm(asked):
    assert [one.answer.alarm for one in asked] == [None] * len(asked)
    assert all(one.answer.fits for one in asked)


@pytest.mark.parametrize("degrees", [60, -60, 180])
def test_gravity_from_elsewhere_raises_the_alarm(servos, degrees):
    answer = ask(servos, 80, tilted(degrees))
    assert not answer.fits and "above the limit of" in answer.alarm


def test_a_rotor_ten_times_too_heavy_raises_the_alarm(servos):
    answer = ask(servos, 81, rotor_inertia=0.05)
    assert not answer.fits
    assert any("edge of the population's range" in note for note in answer.notes)


def test_a_tip_beyond_the_range_raises_the_alarm_though_the_answer_gains(servos):
    """Only ratios to the inertia show in the motion: a lighter servo moves nearly alike, but not as a right one."""
    answer = ask(servos, 82, tip_mass=1.5, rotor_inertia=0.0055, coulomb_friction=0.06)
    assert answer.gain.value > 0.8
    assert not answer.fits and any("edge of the population's range" in note for note in answer.notes)


def test_channels_and_traces_tell_of_the_held_out_part(asked):
    for one in asked[:2]:
        answer = one.answer
        assert {c.channel for c in answer.channels} == {"arm/position", "arm/velocity"}
        assert all(c.answer < c.nominal for c in answer.channels)
        assert {t.episode for t in answer.traces} <= set(answer.parts["test"])
        recorded = {e.name: e for e in one.recording.episodes}
        column = one.recording.columns(["arm/position"])[0]
        for trace in answer.traces:
            rows = np.rint(np.array(trace.time) * 100).astype(int)
            np.testing.assert_allclose(
                trace.measured, recorded[trace.episode].values[rows, column], atol=1e-5
            )
            assert np.abs(np.subtract(trace.answer, trace.measured)).mean() < 0.05


def test_a_gain_is_uncertain_by_its_windows():
    before = np.array([1.0, 1.1, 0.9, 1.0, 1.2, 0.8])
    each = np.arange(6)
    sure = gain(before, 0.5 * before, each)
    assert sure.value == sure.low == sure.high == pytest.approx(0.5)
    unsure = gain(before, np.array([0.1, 1.0, 0.2, 1.1, 0.1, 0.5]), each)
    assert unsure.low < unsure.value < unsure.high <= 1
    few = gain(before[:2], before[:2] / 4, each[:2])
    assert few.value == pytest.approx(0.75) and few.low is None and few.high is None
