"""Robots whose commands carry their own duration: their logs on the grid of the engine, replayed from any row."""

from dataclasses import replace

import numpy as np
import pytest
from timed_khepera import timed_folder, timed_log

from dynreg.replay.timed import on_grid
from dynreg.replay.velocity import told_velocity
from dynreg.replay.windows import windows
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot


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


def test_the_true_simulator_replays_a_timed_log_from_any_row(robot: Robot) -> None:
    """Commands of the dynamic model begin with what the one before told, up to what is left of its lag."""
    cut = windows(robot, timed_log(robot))
    assert cut.period == pytest.approx(0.01) and len(cut) >= 7
    states = rollout(robot, robot.space.nominal[None], cut.run, engine="unicycle").states[0]
    apart = np.hypot(*np.moveaxis((states - cut.measured)[..., :2], -1, 0))
    assert np.nanmax(apart) < 0.02
    still = replace(cut.run, velocity=np.zeros_like(cut.run.velocity))
    lost = rollout(robot, robot.space.nominal[None], still, engine="unicycle").states[0] - cut.measured
    assert np.nanmean(np.hypot(*np.moveaxis(lost[1:, :, :2], -1, 0))) > 1.5 * np.nanmean(apart[1:])


def test_what_a_base_made_of_its_commands(robot: Robot) -> None:
    """Half a second of driving and 0.05 s of turning on the spot: most of the speed is still there."""
    told = np.repeat([[10.0, 10.0], [-5.0, 5.0]], [50, 5], axis=0)
    turning = 10.0 * 0.021 / 0.0884
    speed, yaw = told_velocity(robot, told, 0.01)
    base = robot.file.base
    driven = 0.21 / base.speed_drag * (1 - np.exp(-base.speed_drag * 0.5 / base.speed_lag))
    assert speed == pytest.approx(driven * np.exp(-base.speed_drag * 0.05 / base.speed_lag))
    assert yaw == pytest.approx(turning / base.yaw_drag * (1 - np.exp(-base.yaw_drag * 0.05 / base.yaw_lag)))
    assert told_velocity(load_robot("create"), np.array([[0.1, 0.0], [0.2, -0.4]]), 0.02) == pytest.approx(
        np.array([0.2, -0.4])
    )


def test_a_window_begins_with_the_velocity_that_the_lags_left(robot: Robot) -> None:
    """Without noise the true simulator replays every window, also after commands shorter than a lag."""
    log = timed_log(robot, 120)
    cut = windows(robot, log)
    states = rollout(robot, robot.space.nominal[None], cut.run, engine="unicycle").states[0]
    apart = np.hypot(*np.moveaxis((states - cut.measured)[..., :2], -1, 0))
    assert np.nanmax(apart) < 1e-3
