"""A log that measures torques beside targets tells the gains of the drives."""

import numpy as np
import pytest

from dynreg.data.series import Series
from dynreg.draft.drives import Drive
from dynreg.draft.entry import DraftOptions, Notes
from dynreg.draft.heard import Heard
from dynreg.draft.measured import (
    law_of,
    limit_of,
    with_measured_gains,
    with_measured_limits,
    without_passed_ranges,
)

KP, KD, LIMIT = 80.0, 4.0, 30.0
TIME = np.arange(0.0, 20.0, 0.01)


def log(
    *, kp: float = KP, kd: float = KD, limit: float = LIMIT, unexplained: float = 0.0, seed: int = 0
) -> Heard:
    """What a log tells of a joint that follows steps, with torques at its limit in between."""
    rng = np.random.default_rng(seed)
    target = np.repeat(rng.uniform(-0.5, 0.5, len(TIME) // 100), 100)
    position, velocity = np.zeros((2, len(TIME)))
    for i in range(1, len(TIME)):
        torque = np.clip(kp * (target[i - 1] - position[i - 1]) - kd * velocity[i - 1], -limit, limit)
        velocity[i] = velocity[i - 1] + 0.01 * (torque - 0.5 * np.sin(position[i - 1])) / 0.5
        position[i] = position[i - 1] + 0.01 * velocity[i]
    torque = np.clip(kp * (target - position) - kd * velocity, -limit, limit)
    torque += unexplained * np.std(torque) * rng.standard_normal(len(TIME))
    position = position + 5e-4 * rng.standard_normal(len(TIME))
    named = {"target": target, "position": position, "velocity": velocity, "torque": torque}
    return Heard({f"arm/{name}": Series(TIME, values) for name, values in named.items()})


def test_the_gains_are_those_of_the_samples_below_the_limit():
    law = law_of(log(), Drive("arm", "position", 1.0))
    assert law.gains["gain"] == pytest.approx(KP, rel=0.02) and law.gains["rate_gain"] == pytest.approx(
        KD, rel=0.05
    )


def test_torques_that_follow_something_else_tell_no_gains():
    assert law_of(log(unexplained=0.3), Drive("arm", "position", 1.0)) is None


def test_a_log_without_torques_tells_no_gains():
    series = {name: one for name, one in log().series.items() if name != "arm/torque"}
    assert law_of(Heard(series), Drive("arm", "position", 1.0)) is None


def test_stated_gains_that_the_torques_follow_are_marked_and_kept():
    notes = Notes()
    (drive,) = with_measured_gains([Drive("arm", "position", KP, KD, said="stated")], log(), notes)
    assert drive.measured and (drive.gain, drive.rate_gain) == (KP, KD)
    assert "follow the gains of 1 joint" in notes.lines[0]


def test_guessed_gains_become_those_of_the_log():
    (drive,) = with_measured_gains([Drive("arm", "position", 9.0, 9.0, guessed=True)], log(), Notes())
    assert (
        drive.measured and drive.gain == pytest.approx(KP, rel=0.02) and drive.said == "of the log's torques"
    )


def test_stated_gains_that_the_torques_contradict_stay_and_are_noted():
    notes, stated = Notes(), Drive("arm", "position", 2 * KP, KD, said="stated")
    assert with_measured_gains([stated], log(), notes) == (stated,)
    assert "arm: gain 80" in notes.lines[0] or "arm: gain 79" in notes.lines[0]


def test_a_drive_of_speeds_has_one_gain():
    series = dict(log().series)
    velocity = series["arm/velocity"].values
    command = velocity + np.repeat(np.random.default_rng(1).uniform(-2, 2, len(TIME) // 50), 50)
    series["arm/velocity_command"] = Series(TIME, command)
    series["arm/torque"] = Series(TIME, 3.0 * (command - velocity))
    law = law_of(Heard(series), Drive("arm", "velocity", rate_gain=1.0))
    assert law.gains == {"rate_gain": pytest.approx(3.0, rel=0.01)}


def test_commands_beyond_the_model_s_range_are_no_mistake_of_the_robot():
    """A motor that the model gives 12 N*m, and a log that commands 30: the log's range counts, and it is said."""
    motor, notes = Drive("arm", "torque", low=-12.0, high=12.0), Notes()
    series = Heard({"arm/torque": Series(TIME, LIMIT * np.sin(TIME))})
    (drive,) = without_passed_ranges([motor], series, notes)
    assert drive.usual and "arm: 30, 12" in notes.lines[0]
    quiet = Notes()
    within = Heard({"arm/torque": Series(TIME, 12.0 * np.sin(TIME))})
    assert without_passed_ranges([motor], within, quiet) == (motor,) and not quiet.lines


@pytest.mark.parametrize("seed", range(4))
def test_a_part_too_small_to_be_known_is_neither_measured_nor_contradicted(seed: int):
    told = log(kd=0.0, seed=seed)
    law = law_of(told, Drive("arm", "position", KP))
    assert law is not None and law.gains["rate_gain"] >= 0.0
    notes = Notes()
    (drive,) = with_measured_gains([Drive("arm", "position", KP, 0.0, said="stated")], told, notes)
    assert drive.measured == {"gain"} and "other gains" not in " ".join(notes.lines)


def test_a_stated_gain_that_should_make_a_large_part_is_contradicted_by_none():
    law = law_of(log(kd=0.0), Drive("arm", "position", KP))
    assert law.contradicted({"gain": KP, "rate_gain": 10 * KD}) == {"rate_gain"}


def test_the_limit_is_where_the_torques_stop():
    """The model says 80 N*m, and the log's torques never go beyond 30: the drive gets 30, and it is said."""
    notes, drive = Notes(), Drive("arm", "position", KP, KD, limit=80.0)
    (made,) = with_measured_limits([drive], log(), DraftOptions(), notes)
    assert made.limit == LIMIT and "torque_limit" in made.measured
    assert notes.lines == [
        "the log's torques stop at a limit, which the drive gets (arm: 30, the model says 80)"
    ]
    quiet = Notes()
    (same,) = with_measured_limits(
        [Drive("arm", "position", KP, KD, limit=LIMIT)], log(), DraftOptions(), quiet
    )
    assert same.limit == LIMIT and "torque_limit" in same.measured and not quiet.lines


def test_torques_that_do_not_stop_tell_no_limit():
    drive = Drive("arm", "position", KP, KD)
    noisy = log(unexplained=0.01)  # no two of its largest are the same
    rounded = log()
    values = np.round(rounded.series["arm/torque"].values)
    rounded = Heard({**rounded.series, "arm/torque": Series(TIME, values)})
    free = log(limit=1e3)
    assert [limit_of(told, drive) for told in (noisy, rounded, free, Heard({}))] == [None] * 4
    assert limit_of(log(), drive) == LIMIT


def test_a_limit_that_is_stated_stays_and_another_one_of_the_log_is_noted():
    notes, drive = Notes(), Drive("arm", "position", KP, KD, limit=80.0)
    stated = DraftOptions(torque_limit={"a*": 80.0})
    assert with_measured_limits([drive], log(), stated, notes) == (drive,)
    assert notes.lines == ["the log's torques stop at other limits than those stated (arm: 30)"]
