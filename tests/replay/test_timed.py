"""Robots whose commands carry their own duration: their logs on the grid of the engine, replayed from any row."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.replay.timed import on_grid
from dynreg.replay.velocity import told_velocities
from dynreg.replay.windows import windows
from dynreg.rng import stream
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.spec import ReplayTable
from dynreg.timed.commands import chained, drawn
from dynreg.timed.unicycle import unicycle


@pytest.fixture(scope="module")
def robot() -> Robot:
    """diffdrive with timed commands, seen by a tracker alone, in windows of five seconds."""
    known = load_robot("diffdrive")
    table = known.file.robot.model_copy(update={"control": "timed", "control_rate": None})
    pose = [c for c in known.file.channels if c.name.startswith("base/")]
    given = {"robot": table, "channels": pose, "replay": ReplayTable(horizon=5.0)}
    return replace(known, file=known.file.model_copy(update=given))


def driven(robot: Robot, many: int = 40) -> Recording:
    """A row where each command begins, by the dynamic model with the robot's own lags; times in hundredths."""
    base, commands = robot.file.base, drawn(many, stream(2, "timed"))
    seconds = np.round(commands.seconds, 2)
    commands = replace(commands, seconds=seconds)
    law = [
        getattr(base, n)
        for n in ("speed_lag", "yaw_lag", "centrifugal", "speed_drag", "coupling", "yaw_drag")
    ]
    pose = chained(unicycle(commands, np.array(law), base.track))
    told = np.stack([commands.left, commands.right], axis=1) / base.wheel_radius
    values = np.concatenate([pose, np.concatenate([told, told[-1:]])], axis=1)
    channels = [Channel(c.name, c.unit) for c in robot.file.channels]
    channels += [Channel(a.name, a.unit) for a in robot.file.actions]
    time = 3.0 + np.concatenate([[0.0], np.cumsum(seconds)])
    return Recording(tuple(channels), (Episode("drive", time, values),))


def test_rows_stand_where_they_were_measured_and_commands_hold_between_them(robot: Robot) -> None:
    log = driven(robot)
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
    cut = windows(robot, driven(robot))
    assert cut.period == pytest.approx(0.01) and len(cut) >= 7
    states = rollout(robot, robot.space.nominal[None], cut.run, engine="unicycle").states[0]
    apart = np.hypot(*np.moveaxis((states - cut.measured)[..., :2], -1, 0))
    assert np.nanmax(apart) < 0.02
    still = replace(cut.run, velocity=np.zeros_like(cut.run.velocity))
    lost = rollout(robot, robot.space.nominal[None], still, engine="unicycle").states[0] - cut.measured
    assert np.nanmean(np.hypot(*np.moveaxis(lost[1:, :, :2], -1, 0))) > 1.5 * np.nanmean(apart[1:])


def test_what_commands_ask_of_a_base(robot: Robot) -> None:
    found = told_velocities(robot, np.array([[10.0, 10.0], [-5.0, 5.0]]))
    assert found == pytest.approx(np.array([[0.21, 0.0], [0.0, 10.0 * 0.021 / 0.0884]]))
    create = load_robot("create")
    assert told_velocities(create, np.array([[0.2, -0.4]])) == pytest.approx(np.array([[0.2, -0.4]]))
