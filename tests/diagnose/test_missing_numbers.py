"""A log with stretches of NaN is diagnosed without them, or refused: missing numbers never make a cause."""

from dataclasses import replace

import numpy as np
import pytest
from edited_log import edited

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.errors import LogError
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.replay.timed import held
from dynreg.sim.robot import Robot, load_robot

HELD = "test_0,test_1,test_2,test_3"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def recording(robot: Robot) -> Recording:
    """The log of a robot that lacks nothing."""
    hidden = replace(hide(robot, (), None, 11), parameters=robot.space.nominal)
    return log_of(robot, hidden, protocol(robot, seed=1, reach=0.45), engine="joint")


def lost(recording: Recording, channel: str, every: int, share: slice) -> Recording:
    """The recording without a channel's numbers in rows (of a hundred) of every so many episodes."""
    column = recording.names.index(channel)

    def edit(number: int, values: np.ndarray) -> None:
        rows = slice(len(values) * share.start // 100, len(values) * share.stop // 100)
        if number % every == 0:
            values[rows, column] = np.nan

    return edited(recording, edit)


def filled(recording: Recording, channel: str) -> Recording:
    """The recording with the last number in the place of missing ones."""
    column = recording.names.index(channel)

    def edit(number: int, values: np.ndarray) -> None:
        values[:, [column]] = held(values[:, [column]], np.zeros(1))

    return edited(recording, edit)


@pytest.mark.parametrize("channel", ["arm/position", "arm/target", "supply"])
def test_rollouts_with_holes_are_left_out(robot: Robot, recording: Recording, channel: str):
    asked = DiagnosisOptions(hold_out=HELD, threads=1)
    logs = recording, lost(recording, channel, 4, slice(30, 80))
    whole, some = (pose(robot, log, asked)[1] for log in logs)
    split = some.parts
    kept = whole.windows.episode % 4 != 0
    assert 0 < kept.sum() < len(kept)
    assert some.windows.episode.tolist() == whole.windows.episode[kept].tolist()
    assert np.array_equal(some.windows.measured, whole.windows.measured[kept], equal_nan=True)
    assert np.array_equal(some.windows.run.inputs, whole.windows.run.inputs[kept])
    assert split.fit.any() and split.select.any() and split.test.any()


@pytest.mark.parametrize("channel", ["arm/position", "arm/target", "supply"])
@pytest.mark.parametrize("every", [1, 2])
def test_a_log_with_little_else_is_refused_and_told_where(robot: Robot, recording: Recording, channel, every):
    """Of all episodes, and of all but a few short ones."""
    broken = lost(recording, channel, every, slice(30, 80))
    if every == 2:
        odd = broken.episodes[1::2]
        short = [Episode(e.name, e.time[:6], e.values[:6], e.settings) for e in odd]
        broken = replace(broken, episodes=(*broken.episodes[::2], *short))
    with pytest.raises(LogError, match=rf"{channel} has no value in rows \d+ to \d+ of episode") as error:
        pose(robot, broken, DiagnosisOptions(hold_out="0", threads=1))
    assert "more places" in str(error.value) and "; expected " in str(error.value)


def test_missing_commands_are_no_cause(robot: Robot, recording: Recording, tmp_path):
    """A servo that seems to move without a command has no wrong name, and the result says what was left out."""
    broken = lost(recording, "arm/target", 3, slice(20, 60))
    asked = {
        "hold_out": HELD,
        "effects": ["command_delay", "drive_gain"],
        "threshold_runs": 0,
        "threads": 1,
    }
    with dynreg.open(tmp_path / "registry") as registry:
        found, wrong = (
            registry.diagnose(registry.ingest(log, robot).recording, **asked)
            for log in (broken, filled(broken, "arm/target"))
        )
    assert found.verdict == "none" and not found.causes
    (note,) = [note for note in found.notes if "left out" in note]
    assert note.startswith("arm/target has no value in rows ")
    assert wrong.verdict != "none" and not [note for note in wrong.notes if "left out" in note]
