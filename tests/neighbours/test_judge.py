"""The alarm is raised by robots that no simulator of the family is like, and not by those of the family."""

import mujoco
import numpy as np
import pytest
import secret_servo

from dynreg.replay.judged import gain


def tilted(degrees: float):
    angle = np.deg2rad(degrees)

    def tilt(model: mujoco.MjModel) -> None:
        model.opt.gravity[:] = 9.80665 * np.array([np.sin(angle), 0.0, -np.cos(angle)])

    return tilt


def ask(servos, seed: int, alter=None, **planted: float):
    recording = secret_servo.record(secret_servo.values_of(seed, **planted), seed, alter=alter)
    return servos.query(servos.ingest(recording, "servo_pendulum"))


def test_servos_of_the_family_raise_no_alarm(asked):
    assert [one.answer.alarm for one in asked] == [None] * len(asked)
    assert all(one.answer.fits for one in asked)


@pytest.mark.parametrize("degrees", [60, -60, 180])
def test_gravity_from_elsewhere_raises_the_alarm(servos, degrees):
    answer = ask(servos, 80, tilted(degrees))
    assert not answer.fits and "above the limit of 3" in answer.alarm


def test_a_rotor_ten_times_too_heavy_raises_the_alarm(servos):
    answer = ask(servos, 81, rotor_inertia=0.05)
    assert not answer.fits
    assert any("edge of the population's range" in note for note in answer.notes)


def test_a_tip_of_three_times_the_mass_is_no_stranger(servos):
    """Only ratios to the inertia show in the motion, and the family holds a lighter servo that moves alike."""
    answer = ask(servos, 82, tip_mass=1.5, rotor_inertia=0.0055, coulomb_friction=0.06)
    assert answer.fits and answer.gain.value > 0.8


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
    sure = gain(before, 0.5 * before)
    assert sure.value == sure.low == sure.high == pytest.approx(0.5)
    unsure = gain(before, np.array([0.1, 1.0, 0.2, 1.1, 0.1, 0.5]))
    assert unsure.low < unsure.value < unsure.high <= 1
    few = gain(before[:2], before[:2] / 4)
    assert few.value == pytest.approx(0.75) and few.low is None and few.high is None
