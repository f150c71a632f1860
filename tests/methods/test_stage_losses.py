"""The losses of a stage: joint angles up to a shift, mean velocities, and a simulation that diverged."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.adapt.plan import Stage, StageTable
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import Assumed, UsageError
from dynreg.methods.losses import FASTEST, joint_loss, loss_of, mean_velocities
from dynreg.replay.data import Data, data
from dynreg.replay.velocity import pose_columns
from dynreg.replay.windows import Replayer
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot

TIMES = np.arange(200) * 0.01


def wave(late: int = 0) -> np.ndarray:
    """(1, 200, 1) rad."""
    return np.sin(7.0 * (TIMES - 0.01 * late))[None, :, None]


@pytest.mark.parametrize("late", [-4, 0, 3])
def test_a_log_that_is_late_by_less_than_the_shift_costs_nothing(late: int) -> None:
    assert joint_loss(wave()[None], wave(late), 1, 5)[0] == pytest.approx(0.0, abs=1e-20)


def test_beyond_the_shift_it_costs_what_is_left() -> None:
    (found,) = joint_loss(wave()[None], wave(8), 10, 5)
    left = wave(5)[0, 15:195, 0] - wave(8)[0, 15:195, 0]
    assert found == pytest.approx(float(np.mean(left**2)), rel=1e-9)


def test_each_simulator_has_its_own_shift_and_what_was_not_measured_does_not_count() -> None:
    measured = wave(2)
    measured[:, 100:] = np.nan
    both = np.stack([wave(), wave(4)])
    np.testing.assert_allclose(joint_loss(both, measured, 1, 3), 0.0, atol=1e-20)


def test_no_shift_moves_what_was_measured_out_of_what_counts() -> None:
    measured = np.zeros((1, 40, 1))
    measured[:, 17:] = np.nan
    steady = np.full((2, 1, 40, 1), [[[[1.0]]], [[[2.0]]]])
    np.testing.assert_allclose(joint_loss(steady, measured, 1, 10), [1.0, 4.0])


def test_a_simulation_that_diverged_is_the_worst() -> None:
    broken = np.full((1, 1, 200, 1), np.nan)
    assert joint_loss(broken, wave(), 1, 2)[0] == pytest.approx(np.pi**2)


def recorded(robot: Robot) -> Data:
    """What the nominal robot did, without noise."""
    run = excitation(robot, seed=4, name="losses", episodes=4, steps=100)
    states = rollout(robot, robot.space.nominal[None], run).states[0]
    told = [a for a in (run.actions, run.inputs) if a is not None]
    table = np.concatenate([states, *(np.concatenate([a, a[:, -1:]], axis=1) for a in told)], axis=-1)
    units = {one.name: one.unit for one in (*robot.file.channels, *robot.file.actions, *robot.file.inputs)}
    names = (*robot.channels, *robot.actions, *(robot.inputs if run.inputs is not None else ()))
    channels = tuple(Channel(name, units.get(name, "1")) for name in names)
    settings = [{s.name: row[i] for i, s in enumerate(robot.file.settings)} for row in run.settings]
    time = np.arange(table.shape[1]) / robot.rate
    episodes = tuple(Episode(f"run{e}", time, table[e], settings[e]) for e in range(len(table)))
    return data(robot, Recording(channels, episodes))


def of(cut: Data, loss: str, **told):
    table = StageTable(name="one", parameters=["*"], loss=loss, **told)
    stage = Stage(table, np.arange(len(cut.robot.space)), cut.parts.chosen)
    return loss_of(stage, cut, Replayer(cut.robot, cut.windows))


@pytest.mark.parametrize(
    ("robot", "loss"), [("servo_pendulum", "joint"), ("servo_pendulum", "replay"), ("diffdrive", "velocity")]
)
def test_the_robot_itself_has_the_least_loss(robot: str, loss: str) -> None:
    cut = recorded(load_robot(robot))
    found = of(cut, loss)
    others = stream(0, "losses").uniform(size=(8, len(cut.robot.space)))
    losses = found.of(np.concatenate([cut.robot.space.to_unit(cut.start)[None], others]))
    assert losses[0] < 0.02 * losses[1:].min()
    assert (losses <= found.most).all() and found.most in (10.0, np.pi**2, FASTEST**2)


@pytest.mark.parametrize(("robot", "loss"), [("servo_pendulum", "velocity"), ("diffdrive", "joint")])
def test_a_loss_that_no_channel_tells_is_refused(robot: str, loss: str) -> None:
    with pytest.raises(UsageError, match=f"loss '{loss}' of '{robot}'"):
        of(recorded(load_robot(robot)), loss)


def test_joints_that_slide_count_in_no_loss_of_angles_and_are_told() -> None:
    """Metres and radians do not add up: as if the sliding joint had not been measured."""
    cut = recorded(load_robot("double_pendulum"))
    own = [i for i, name in enumerate(cut.robot.channels) if name.endswith("/position")]
    channels = list(cut.robot.file.channels)
    channels[own[1]] = channels[own[1]].model_copy(update={"unit": "m"})
    sliding = replace(cut.robot, file=cut.robot.file.model_copy(update={"channels": channels}))
    points = stream(2, "losses").uniform(size=(3, len(cut.robot.space)))
    with pytest.warns(Assumed, match=f"leaves out {channels[own[1]].name}; loss 'replay' counts them"):
        found = of(replace(cut, robot=sliding), "joint").of(points)
    measured = cut.windows.measured.copy()
    measured[..., own[1]] = np.nan
    unmeasured = replace(cut, windows=replace(cut.windows, measured=measured))
    np.testing.assert_allclose(found, of(unmeasured, "joint").of(points))
    assert (np.abs(found / of(cut, "joint").of(points) - 1.0) > 0.01).all()


def test_a_stage_that_skips_all_rows_is_refused() -> None:
    with pytest.raises(UsageError, match="skip = 50 s"):
        of(recorded(load_robot("servo_pendulum")), "replay", skip=50.0)


@pytest.mark.parametrize("loss", ["replay", "joint"])
def test_a_log_that_ends_before_what_is_skipped_does_not_count(loss: str) -> None:
    cut = recorded(load_robot("servo_pendulum"))
    measured = cut.windows.measured.copy()
    measured[cut.parts.chosen[0], 20:] = np.nan
    short = replace(cut, windows=replace(cut.windows, measured=measured))
    kept = np.isin(np.arange(len(cut.windows)), cut.parts.chosen[1:])
    rest = replace(cut.parts, fit=kept, select=np.zeros_like(kept))
    points = stream(1, "losses").uniform(size=(5, len(cut.robot.space)))
    found = of(short, loss, skip=0.3).of(points)
    np.testing.assert_allclose(found, of(replace(cut, parts=rest), loss, skip=0.3).of(points))
    measured[cut.parts.chosen, 20:] = np.nan
    with pytest.raises(UsageError, match="measured .*behind skip = 0.3 s"):
        of(short, loss, skip=0.3)


@pytest.mark.parametrize("every", [2, 5])
def test_the_velocity_of_a_slow_camera_is_told_from_pose_to_pose(every: int) -> None:
    cut = recorded(load_robot("diffdrive"))
    measured, pose = cut.windows.measured.copy(), pose_columns(cut.robot)
    rows = np.arange(measured.shape[1]) % every != 1
    measured[:, rows[:, None] & np.isin(np.arange(measured.shape[2]), pose)] = np.nan
    slow = replace(cut, windows=replace(cut.windows, measured=measured))
    points = stream(2, "losses").uniform(size=(6, len(cut.robot.space)))
    points = np.concatenate([cut.robot.space.to_unit(cut.start)[None], points])
    seen, whole = of(slow, "velocity").of(points), of(cut, "velocity").of(points)
    assert seen[0] < 1e-6 * seen[1:].min() and (seen < FASTEST**2).all()
    np.testing.assert_allclose(seen[1:], whole[1:], rtol=0.25)


def test_windows_with_one_pose_tell_no_velocity() -> None:
    cut = recorded(load_robot("diffdrive"))
    measured = cut.windows.measured.copy()
    measured[:, 2:] = np.nan
    once = replace(cut, windows=replace(cut.windows, measured=measured))
    with pytest.raises(UsageError, match="too few poses or speeds were measured behind skip = 0 s"):
        of(once, "velocity")


def test_a_circle_has_the_speed_and_the_turn_of_its_arc() -> None:
    """Of chords that each begin at a heading: ahead r sin(a), left r (1 - cos(a)), turned by a."""
    cut, radius, turn = recorded(load_robot("diffdrive")), 0.5, 0.8
    angle = turn * cut.windows.period * np.arange(cut.windows.measured.shape[1])
    pose = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), angle], axis=-1)
    states = np.zeros(cut.windows.measured.shape[1:])
    states[:, pose_columns(cut.robot)] = pose
    for every in (1, 4):
        states[np.arange(len(states)) % every != 0] = np.nan
        step, seconds = every * angle[1], every * cut.windows.period
        chord = [radius * np.sin(step) / seconds, radius * (1 - np.cos(step)) / seconds, turn]
        np.testing.assert_allclose(mean_velocities(cut)(states), chord, rtol=1e-9)


def test_a_log_that_ends_within_the_shift_is_left_out() -> None:
    cut = recorded(load_robot("servo_pendulum"))
    measured, shift = cut.windows.measured.copy(), 10 * cut.windows.period
    measured[cut.parts.chosen[0], 11:] = np.nan
    short = replace(cut, windows=replace(cut.windows, measured=measured))
    assert of(short, "joint", shift=shift).windows.tolist() == cut.parts.chosen[1:].tolist()
    measured[cut.parts.chosen, 11:] = np.nan
    with pytest.raises(UsageError, match="no joint angle was measured up to shift"):
        of(short, "joint", shift=shift)


def test_a_simulation_that_diverges_where_nothing_was_measured_is_judged_by_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cut = recorded(load_robot("diffdrive"))
    measured = cut.windows.measured.copy()
    measured[:, 60:] = np.nan
    fell = replace(cut, windows=replace(cut.windows, measured=measured))
    states = Replayer.states

    def diverging(self, *told):
        out = states(self, *told)
        out[:, :, 70:] = np.nan
        return out

    whole = of(fell, "velocity").of(cut.robot.space.to_unit(cut.start)[None])
    monkeypatch.setattr(Replayer, "states", diverging)
    assert of(fell, "velocity").of(cut.robot.space.to_unit(cut.start)[None]) == whole


def test_what_slides_and_what_is_not_scored_does_not_count_as_an_angle(tmp_path: Path) -> None:
    """Metres were added to radians, and a carriage of a millimetre weighed as a milliradian."""
    with pytest.raises(UsageError, match="no channel of a joint's angle"):
        of(recorded(load_robot("emps")), "joint")
    folder = tmp_path / "arm"
    shutil.copytree(load_robot("two_joint_arm").folder, folder)
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    name = 'name = "elbow/position"\n'
    (folder / "robot.toml").write_text(text.replace(name, f"{name}weight = 0\n"), encoding="utf-8")
    cut = recorded(load_robot(folder))
    column = cut.robot.channels.index("elbow/position")
    other = replace(cut, windows=replace(cut.windows, measured=cut.windows.measured.copy()))
    other.windows.measured[..., column] += 1.0
    begin = cut.robot.space.to_unit(cut.start)[None]
    assert of(cut, "joint").of(begin) == of(other, "joint").of(begin)
