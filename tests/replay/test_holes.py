"""Holes of a recording are found where a signal is silent for longer than usual, and the windows that they hit."""

from dataclasses import replace

import numpy as np
import pytest
import secret_servo

from dynreg.data.recording import Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.errors import LogError, UsageError
from dynreg.replay.cut import windows
from dynreg.replay.holes import Hole, hit, holes, sentence, without_start
from dynreg.replay.parts import parts
from dynreg.sim.robot import Robot, load_robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return secret_servo.record(secret_servo.values_of(1), 1, episodes=5, steps=60)


def emptied(recording: Recording, *places: tuple[int, str, slice]) -> Recording:
    """The recording without the numbers of some channels in some rows of some episodes."""
    table = [e.values.copy() for e in recording.episodes]
    for number, channel, rows in places:
        table[number][rows, recording.names.index(channel)] = np.nan
    pairs = zip(recording.episodes, table, strict=True)
    episodes = tuple(Episode(e.name, e.time, values, e.settings) for e, values in pairs)
    return replace(recording, episodes=episodes)


def test_a_whole_recording_has_none(robot, recording):
    assert holes(robot, recording) == ()
    assert not hit(robot, recording, windows(robot, recording), ()).any()


@pytest.mark.parametrize("channel", ["arm/position", "arm/target", "supply", "arm/enabled"])
def test_a_long_silence_is_a_hole_and_a_short_one_is_none(robot, recording, channel: str):
    period = recording.episodes[0].time[1]
    long, short = int(0.3 / period), max(int(0.1 / period) - 1, 1)
    place, other = (1, channel, slice(10, 10 + long)), (2, channel, slice(20, 20 + short))
    some = emptied(recording, place, other)
    found = holes(robot, some)
    assert found == (Hole(channel, 1, 10, 9 + long),)
    assert hit(robot, some, windows(robot, some), found).tolist() == [False, True, False, False, False]
    said = sentence(recording, (*found, Hole(channel, 3, 4, 5)))
    assert said.startswith(f"{channel} has no value in rows 10 to {9 + long} of episode 'run1'")
    assert said.endswith("(and in 1 more places)")


def test_windows_beside_a_hole_have_none(robot, recording):
    cut = windows(robot, recording, horizon=0.2)
    mine = np.flatnonzero(cut.episode == 0)
    first, stop = (int(row) for row in cut.rows[mine[1]])
    touched = hit(robot, recording, cut, [Hole("arm/position", 0, first + 1, stop - 2)])
    assert np.flatnonzero(touched).tolist() == [mine[1]]
    both = hit(robot, recording, cut, [Hole("arm/position", 0, stop - 1, stop)])
    assert np.flatnonzero(both).tolist() == [mine[1], mine[2]]


def test_a_slow_sensor_has_none_between_its_samples(robot, recording):
    slow = [(e, "arm/velocity", np.arange(61) % 20 != 0) for e in range(5)]
    assert holes(robot, emptied(recording, *slow)) == ()


def test_what_an_episode_lacks_altogether(robot, recording):
    everything = slice(None)
    assert holes(robot, emptied(recording, (3, "arm/velocity", everything))) == ()
    assert holes(robot, emptied(recording, (3, "supply", everything))) == (Hole("supply", 3, 0, 60),)
    unmeasured = emptied(recording, *((3, name, everything) for name in recording.names))
    assert holes(robot, unmeasured) == (), "there is nothing to be held against"


def test_episodes_without_a_channel_that_others_have_are_said_to_be_left_out(robot, recording):
    """Seven of ten were, of weight 0 as this is, and nobody was told."""
    light = [
        c.model_copy(update={"weight": 0.0 if c.name == "arm/velocity" else c.weight})
        for c in robot.file.channels
    ]
    robot = replace(robot, file=robot.file.model_copy(update={"channels": light}))
    assert without_start(robot, recording) == ""
    some = emptied(recording, *((number, "arm/velocity", slice(None)) for number in (1, 3)))
    assert windows(robot, some).episode.tolist() == [0, 2, 4]
    assert (
        without_start(robot, some)
        == "2 of 5 episodes are left out: they lack arm/velocity, which others have"
    )
    with pytest.raises(
        LogError, match="the recording makes 1 rollout.*: 4 of 5 episodes are left out: they lack arm"
    ):
        pose(
            robot,
            emptied(recording, *((n, "arm/velocity", slice(None)) for n in range(4))),
            DiagnosisOptions(),
        )
    every = emptied(recording, *((number, "arm/velocity", slice(None)) for number in range(5)))
    assert without_start(robot, every) == "" and len(windows(robot, every)) == 5


def test_inputs_hold_where_they_hold_no_number(robot, recording):
    column = robot.inputs.index("supply")
    cut = windows(robot, emptied(recording, (1, "supply", slice(10, 20)), (3, "supply", slice(None))))
    supply = cut.run.inputs[..., column]
    assert (supply[1, 10:20] == supply[1, 9]).all()
    assert (supply[3] == robot.input_defaults[column]).all()


def test_what_is_held_out_must_have_rollouts(robot, recording):
    cut = windows(robot, recording).take(np.array([0, 1, 2, 3]))
    with pytest.raises(UsageError, match="'run4' has no rollout"):
        parts(recording, cut, "run4")
