"""A recording is replayed from its measured states, and a replay of the truth has no error."""

from dataclasses import replace

import numpy as np
import pytest
import secret_servo
from edited_log import edited

from dynreg.data.recording import Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.errors import LogError
from dynreg.replay.cut import windows
from dynreg.replay.parts import parts
from dynreg.replay.windows import Replayer, errors, follows, moves, scales, stuck
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.unscored import unscored_notes


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return secret_servo.record(secret_servo.values_of(1), 1, episodes=5, steps=60)


def with_horizon(robot: Robot, seconds: float) -> Robot:
    table = robot.file.replay.model_copy(update={"horizon": seconds})
    return replace(robot, file=robot.file.model_copy(update={"replay": table}))


def columns(recording: Recording, *names: str) -> list[int]:
    return recording.columns(names).tolist()


def exact(robot: Robot, values: np.ndarray) -> Recording:
    """A recording without noise on the robot's own time step."""
    run = excitation(robot, seed=3, name="exact", episodes=4, steps=40)
    states = rollout(robot, values[None], run).states[0]
    held = lambda a: np.concatenate([a, a[:, -1:]], axis=1)  # noqa: E731
    table = np.concatenate([states, held(run.actions), held(run.inputs)], axis=-1)
    like = secret_servo.record(values, 3, episodes=4, steps=40)
    episodes = [Episode(e.name, e.time, table[i], e.settings) for i, e in enumerate(like.episodes)]
    return Recording(like.channels, tuple(episodes))


def test_a_replay_of_the_truth_has_no_error_and_one_of_another_servo_has(robot):
    values = np.stack([secret_servo.values_of(seed) for seed in (1, 2)])
    cut = windows(robot, exact(robot, values[0]))
    replayer = Replayer(robot, cut)
    found = errors(replayer.residuals(values, np.arange(len(cut))))
    assert found[0].max() < 1e-9 and found[1].min() > 1e-3
    assert replayer.rollouts == 2


def test_windows_carry_what_was_told_before_them(robot, recording):
    cut = windows(with_horizon(robot, 0.2), recording)
    before, (told,) = cut.run.before, columns(recording, "arm/target")
    assert before.shape == (15, 100, 1) and np.isnan(before[::3]).all()
    for w in (1, 2, 5):
        first = cut.rows[w, 0]
        np.testing.assert_array_equal(
            before[w, 100 - first :, 0], recording.episodes[w // 3].values[:first, told]
        )
        assert np.isnan(before[w, : 100 - first]).all()
    assert windows(robot, recording).run.before is None, "whole episodes"


def test_windows_cover_the_episodes_and_start_from_what_was_measured(robot, recording):
    cut = windows(with_horizon(robot, 0.2), recording)
    assert len(cut) == 5 * 3 and cut.run.steps == 20 and cut.period == pytest.approx(0.01)
    state, target = columns(recording, *robot.channels), columns(recording, "arm/target")
    for w in range(len(cut)):
        values = recording.episodes[cut.episode[w]].values[slice(*cut.rows[w])]
        np.testing.assert_array_equal(cut.measured[w], values[:, state])
        np.testing.assert_array_equal(cut.run.initial[w], values[0, state])
        np.testing.assert_array_equal(cut.run.actions[w], values[:-1, target])
        assert cut.run.settings[w, 0] == recording.episodes[cut.episode[w]].settings["kp"]
    few = cut.take(np.array([4, 7]))
    np.testing.assert_array_equal(few.measured, cut.measured[[4, 7]])
    np.testing.assert_array_equal(few.rows, cut.rows[[4, 7]])


def test_episodes_of_different_length_are_padded_with_nothing(robot, recording):
    e = recording.episodes[2]
    short = Episode(e.name, e.time[:31], e.values[:31], e.settings)
    mixed = Recording(recording.channels, (*recording.episodes[:2], short))
    cut = windows(robot, mixed)
    assert np.isnan(cut.measured[2, 31:]).all() and np.isfinite(cut.measured[2, :31]).all()
    value = secret_servo.values_of(2)[None]
    padded = Replayer(robot, cut).states(value, np.array([2]))
    alone = Replayer(robot, windows(robot, Recording(recording.channels, (short,)))).states(
        value, np.array([0])
    )
    np.testing.assert_allclose(padded[:, :, :31], alone, atol=1e-9)


def test_weights_are_shares_and_spreads_never_below_the_noise(robot, recording):
    cut = windows(robot, recording)
    np.testing.assert_allclose(cut.weight, [1.0, 0.0])
    still = edited(
        recording, lambda _, v: v.__setitem__((slice(None), columns(recording, *robot.channels)), 0.3)
    )
    np.testing.assert_allclose(windows(robot, still).spread, [0.001534, 0.024])


def both_scored(robot: Robot) -> Robot:
    every = [c.model_copy(update={"weight": 1.0}) for c in robot.file.channels]
    return replace(robot, file=robot.file.model_copy(update={"channels": every}))


def test_a_channel_that_holds_still_is_not_scored_beside_one_that_moves(robot, recording):
    """Its unit was its noise, so a simulator that erred there by a hundredth of the motion was all wrong."""
    velocity, robot = columns(recording, "arm/velocity"), both_scored(robot)
    noise = 0.024 * np.random.default_rng(1).standard_normal((61, 1))
    still = edited(recording, lambda _, v: v.__setitem__((slice(None), velocity), noise))
    cut = windows(robot, still)
    np.testing.assert_allclose(windows(robot, recording).weight, [0.5, 0.5])
    np.testing.assert_allclose(cut.weight, [1.0, 0.0])
    told = unscored_notes(robot, cut, parts(still, cut, None))
    assert told == ("arm/velocity moves by no more than 3 times the noise in robot.toml: no error counts it",)
    assert unscored_notes(robot, windows(robot, recording), parts(recording, cut, None)) == ()


def test_a_joint_that_was_told_to_move_and_holds_still_is_scored_by_the_motion_that_it_was_told():
    """Without a unit of its own a stuck joint counted for nothing, and "nothing is wrong" was the answer."""
    robot = load_robot("two_joint_arm")
    run = excitation(robot, seed=3, name="stuck", episodes=2, steps=60)
    states = rollout(robot, robot.space.nominal[None], run).states[0]
    cut = lambda rows: scales(robot, rows, run.actions)  # noqa: E731
    (spread, weight), (action, column) = cut(states), follows(robot)[1]
    still = states.copy()
    still[..., column] = 0.2
    found, scored = cut(still)
    assert weight[column] > 0 and np.array_equal(scored, weight)
    told = float(run.actions[..., action].std())
    assert stuck(robot, still, run.actions) == {column: pytest.approx(told)} and found[
        column
    ] == pytest.approx(told)
    assert np.array_equal(np.delete(found, column), np.delete(spread, column))
    assert not stuck(robot, states, run.actions)
    held = np.array(run.actions)
    held[..., action] = 0.2  # it was told to hold still: nothing to score
    assert scales(robot, still, held)[1][column] == 0 and not stuck(robot, still, held)
    nothing = np.broadcast_to(states[:1, :1], states.shape)  # no joint moves: that is no stuck joint
    assert not moves(robot, scales(robot, nothing, run.actions)[0]).any()


def test_a_sensor_that_is_slower_than_rollouts_is_not_scored(robot, recording):
    """A diagnosis searched to the end, and then had no error to tell of it."""
    velocity, robot = columns(recording, "arm/velocity"), both_scored(robot)
    slow = edited(recording, lambda _, v: v.__setitem__((np.arange(61) % 20 > 0, velocity[0]), np.nan))
    model, data = pose(robot, slow, DiagnosisOptions(horizon=0.15, threads=1))
    assert data.use.tolist() == [0] and windows(robot, slow).weight.tolist() == [0.5, 0.5]
    (told,) = unscored_notes(robot, data.windows, data.parts)
    assert told.startswith("arm/velocity has no value after the start of a rollout: no error counts it")


def test_a_simulation_that_diverged_counts_as_ten_times_the_motion(robot, recording, monkeypatch):
    replayer = Replayer(robot, windows(robot, recording))
    lost = lambda self, v, chosen, initial: np.full((len(v), len(chosen), 61, 2), np.nan)  # noqa: E731
    monkeypatch.setattr(Replayer, "states", lost)
    np.testing.assert_array_equal(errors(replayer.residuals(robot.space.nominal[None], np.arange(5))), 10.0)


def test_rows_that_were_not_measured_count_for_nothing(robot, recording):
    state = columns(recording, *robot.channels)

    def lose(number, values):
        if number == 1:
            values[30:, state] = np.nan

    value = secret_servo.values_of(2)[None]
    lost = Replayer(robot, windows(robot, edited(recording, lose))).residuals(value, np.arange(5))
    assert np.isnan(lost[:, 1, 29:]).all() and np.isfinite(errors(lost)).all()


def test_a_window_begins_where_its_state_was_measured(robot, recording):
    state = columns(recording, *robot.channels)

    def lose(number, values):
        values[: 7 * number, state] = np.nan

    cut = windows(robot, edited(recording, lose))
    np.testing.assert_array_equal(cut.rows[:, 0], [0, 7, 14, 21, 28])
    assert np.isfinite(cut.run.initial).all()


def test_a_window_in_which_nothing_was_measured_is_left_out(robot, recording):
    state = columns(recording, *robot.channels)

    def lose(number, values):
        if number == 3:
            values[1:, state] = np.nan

    cut = windows(robot, edited(recording, lose))
    assert cut.episode.tolist() == [0, 1, 2, 4]


def test_a_command_that_was_not_logged_is_the_last_one_held(robot, recording):
    target = columns(recording, "arm/target")[0]

    def lose(number, values):
        values[10:13, target] = np.nan

    cut = windows(robot, edited(recording, lose))
    full = windows(robot, recording).run.actions
    np.testing.assert_array_equal(cut.run.actions[:, 9:13], np.tile(full[:, 9:10], (1, 4, 1)))
    np.testing.assert_array_equal(cut.run.actions[:, 13:], full[:, 13:])


def test_a_window_between_two_commands_has_the_one_that_stands(robot, recording):
    target = columns(recording, "arm/target")[0]

    def lose(number, values):
        values[:, target] = np.where(np.arange(len(values)) % 40 == 0, values[:, target], np.nan)

    fine = with_horizon(robot, 0.25)
    changed = edited(recording, lose)
    cut = windows(fine, changed)
    for window in np.flatnonzero(cut.episode == 1):
        first = int(cut.rows[window, 0])
        assert cut.run.actions[window, 0, 0] == changed.episodes[1].values[first // 40 * 40, target]


def test_recordings_that_cannot_be_replayed_say_why(robot, recording):
    drop = lambda name: Recording(  # noqa: E731
        tuple(c for c in recording.channels if c.name != name),
        tuple(
            Episode(e.name, e.time, np.delete(e.values, columns(recording, name), axis=1), e.settings)
            for e in recording.episodes
        ),
    )
    with pytest.raises(LogError, match="the recording has no commands"):
        windows(robot, drop("arm/target"))
    with pytest.raises(LogError, match="arm/velocity"):
        windows(robot, drop("arm/velocity"))
    rows = tuple(Episode(e.name, e.time[:1], e.values[:1], e.settings) for e in recording.episodes)
    with pytest.raises(LogError, match="rows? "):
        windows(robot, Recording(recording.channels, rows))
    position = columns(recording, "arm/position")
    with pytest.raises(LogError, match="measured"):
        windows(robot, edited(recording, lambda _, v: v.__setitem__((slice(None), position), np.nan)))
