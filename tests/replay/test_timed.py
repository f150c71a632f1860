"""Robots whose commands carry their own duration: their logs on the grid of the engine, replayed from any row."""

from dataclasses import replace

import numpy as np
import pytest
from timed_khepera import timed_folder, timed_log

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.verdict import begin_noise
from dynreg.replay.cut import unbroken, windows
from dynreg.replay.timed import on_grid
from dynreg.replay.velocity import pose_columns
from dynreg.replay.windows import ANYWHERE
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(timed_folder(tmp_path_factory.mktemp("timed")))


def test_rows_stand_where_they_were_measured_and_commands_hold_between_them(robot: Robot) -> None:
    log = timed_log(robot)
    first, grid = log.episodes[0], on_grid(robot, log).episodes[0]
    assert np.diff(grid.time) == pytest.approx(robot.file.robot.timestep)
    known = np.isfinite(grid.values[:, :3]).all(axis=1)
    assert grid.time[known] == pytest.approx(first.time) and np.isnan(grid.values[~known, :3]).all()
    np.testing.assert_array_equal(grid.values[known], first.values)
    held = np.searchsorted(first.time, grid.time + 1e-6, side="right") - 1
    np.testing.assert_array_equal(grid.values[:, 3:], first.values[held, 3:])
    fixed = load_robot("diffdrive")
    assert on_grid(fixed, log) is log


@pytest.mark.parametrize("name", ["create", "diffdrive"])
def test_a_base_goes_on_with_what_its_own_lags_made_of_earlier_commands(name: str) -> None:
    """Told 5 s in one go or from the third second on: the same, for every simulator; also beyond its limits."""
    known = load_robot(name)
    slow = [d.model_copy(update={"lag": 0.3}) for d in known.file.drives]
    slow = replace(known, file=known.file.model_copy(update={"drives": slow}))
    rng, values = stream(1, "told"), slow.space.sample(0, 4, 0)
    top = np.array([a.high for a in slow.file.actions])
    told = np.repeat(rng.uniform(-1.5 * top, 1.5 * top, (50, 2)), 5, axis=0)
    whole = rollout(slow, values, Run(told[None], period=0.02), engine="kinematic").states[:, 0]
    for v, states in zip(values, whole, strict=True):
        run = Run(told[None, 150:], initial=states[None, 150], period=0.02, before=told[None, :150])
        if name == "diffdrive":
            run.initial[:, :4] = np.nan  # the wheels' speeds would tell it
        columns = pose_columns(slow)
        found = rollout(slow, v[None], run, engine="kinematic").states[0, 0][:, columns]
        np.testing.assert_allclose(found, states[150:, columns], atol=1e-6)
        still = rollout(slow, v[None], replace(run, before=None), engine="kinematic").states[0, 0][:, columns]
        assert np.abs(still - states[150:, columns]).max() > 1e-3


@pytest.mark.parametrize("seconds", [(0.1, 2.0), (0.1, 0.1)])
def test_the_true_simulator_replays_a_timed_log_from_any_row(
    robot: Robot, seconds: tuple[float, float]
) -> None:
    """Without noise, also where commands are shorter than a lag; not from a standstill."""
    cut = windows(robot, timed_log(robot, 120 if seconds[1] > 1 else 400, seconds=seconds))
    assert cut.period == pytest.approx(0.01) and len(cut) >= 7
    states = rollout(robot, robot.space.nominal[None], cut.run, engine="unicycle").states[0]
    assert np.nanmax(np.abs(states - cut.measured)) < 1e-3
    still = replace(cut.run, velocity=np.zeros_like(cut.run.velocity), before=None)
    lost = rollout(robot, robot.space.nominal[None], still, engine="unicycle").states[0] - cut.measured
    assert np.nanmax(np.abs(lost)) > 5e-3


def test_a_gap_leaves_out_the_windows_about_it_and_no_others(robot: Robot) -> None:
    """Rows of the log and of the grid were compared: the first window was left out, and that with the gap kept."""
    log = timed_log(robot, 60)
    (first,) = log.episodes
    values, gap = first.values.copy(), slice(30, 36)
    values[gap, :3] = np.nan
    log = replace(log, episodes=(replace(first, values=values),))
    every = windows(robot, log, horizon=3.0)
    begin = first.time[0] + every.run.begin
    end = begin + every.period * (every.rows[:, 1] - every.rows[:, 0] - 1)
    whole = (end < first.time[gap][0]) | (begin > first.time[gap][-1])
    assert whole[0] and whole[-1] and 0 < (~whole).sum() < 6
    np.testing.assert_array_equal(unbroken(robot, log, 3.0).rows, every.rows[whole])


def test_a_base_that_rolls_on_between_rare_poses_does_not_stand(robot: Robot) -> None:
    """Told to stop where a window begins, it rolls 3 mm further: less than five times the noise of its two poses."""
    step, told = 0.01, np.repeat([[2.0, 2.0], [0.0, 0.0], [3.0, 1.0]], [500, 50, 500], axis=0)
    run = Run(told[None], period=step)
    states = rollout(robot, robot.space.nominal[None], run, engine="unicycle").states[0, 0]
    rows = np.array([0, 500, 550, 700, 900, 1000])
    values = np.concatenate([states[rows], told[np.minimum(rows, 1049)]], axis=1)
    tables = (*robot.file.channels, *robot.file.actions)
    log = Recording(tuple(Channel(t.name, t.unit) for t in tables), (Episode("drive", step * rows, values),))
    cut = windows(robot, log)
    at = int(np.flatnonzero(cut.rows[:, 0] == 500)[0])
    assert 0.001 < states[550, 0] - states[500, 0] < 0.005
    assert cut.run.initial[at] == pytest.approx(states[500])
    assert begin_noise(robot, cut.take(np.array([at])))[2] == pytest.approx(robot.sensor_noise[2])


def test_a_log_of_many_poses_may_begin_on_the_way(robot: Robot) -> None:
    told = np.tile([[8.0, 7.0]], (400, 1))
    x = rollout(robot, robot.space.nominal[None], Run(told[None], period=0.01), engine="unicycle").states[
        0, 0, 100:
    ]
    tables = (*robot.file.channels, *robot.file.actions)
    values = np.concatenate([x, np.tile([[8.0, 7.0]], (len(x), 1))], axis=1)
    log = Recording(
        tuple(Channel(t.name, t.unit) for t in tables),
        (Episode("drive", 0.01 * np.arange(len(x)), values),),
    )
    cut = windows(robot, log)
    (states,) = rollout(robot, robot.space.nominal[None], cut.run).states
    assert cut.run.velocity[0, 0] > 0.1 and np.nanmax(np.abs(states - cut.measured)) < 2e-3


def test_commands_hold_where_none_is_logged_also_for_whole_turns(robot: Robot) -> None:
    """Rows in which neither a pose nor a command was logged change nothing."""
    log = timed_log(robot, 120)
    (first,) = log.episodes
    wrapped = first.values.copy()
    wrapped[:, 2] = (wrapped[:, 2] + np.pi) % (2 * np.pi) - np.pi
    time = np.sort(np.concatenate([first.time, first.time[:-1] + 0.02]))
    values = np.full((len(time), wrapped.shape[1]), np.nan)
    values[np.isin(time, first.time)] = wrapped
    holes = replace(log, episodes=(Episode("drive", time, values),))
    found, whole = (on_grid(robot, r).episodes[0].values[:, 2] for r in (holes, log))
    known = np.isfinite(whole)
    np.testing.assert_allclose(found[known], whole[known], atol=1e-9)


def test_turns_do_not_add_to_what_a_heading_may_be(robot: Robot) -> None:
    cut = windows(robot, timed_log(robot, 300))
    assert np.nanstd(cut.measured[..., 2]) > 3.0 and cut.spread[2] == ANYWHERE == pytest.approx(
        1.8138, rel=1e-4
    )


def test_a_yaw_within_one_turn_goes_on_through_whole_turns(robot: Robot) -> None:
    log = timed_log(robot, 120)
    (first,) = log.episodes
    values = first.values.copy()
    values[:, 2] = (values[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(first.values[:, 2]).max() > 2 * np.pi
    wrapped = replace(log, episodes=(replace(first, values=values),))
    found, whole = (on_grid(robot, r).episodes[0].values for r in (wrapped, log))
    np.testing.assert_allclose(found, whole, atol=1e-9)


def test_rows_in_which_nothing_was_measured_do_not_stand_still(robot: Robot) -> None:
    """Two seconds at rest with two measured poses: their mean is the start, and no other row counts."""
    log = timed_log(robot, 40, noise=1.0, rest=2.0)
    cut = windows(robot, log)
    measured = cut.measured[0][:201]
    rows = np.flatnonzero(np.isfinite(measured).all(axis=1))
    assert list(rows) == [0, 200]
    assert cut.run.initial[0] == pytest.approx(measured[rows].mean(axis=0))
    assert begin_noise(robot, cut.take(np.array([0])))[2] == pytest.approx(robot.sensor_noise[2] / np.sqrt(2))
