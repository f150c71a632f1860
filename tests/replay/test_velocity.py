"""How fast a base is on its way where a replay begins."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.replay.cut import windows
from dynreg.replay.velocity import base_velocities
from dynreg.replay.windows import Windows
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

PERIOD = 0.02


@pytest.fixture(scope="module")
def create() -> Robot:
    return load_robot("create")


def driven(robot: Robot, steps: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Commands (T, 2) that change every second and a half, and states (T+1, 3) from rest."""
    rng = np.random.default_rng(4)
    told = np.repeat(rng.uniform([0.02, -0.6], [0.3, 0.6], (steps // 75, 2)), 75, axis=0)
    told[:50] = 0.0
    run = Run(told[None], initial=np.array([[0.5, -1.0, 3.0]]), period=PERIOD)
    return told, rollout(robot, robot.space.nominal[None], run).states[0, 0]


def test_the_slope_of_the_poses_is_the_speed_whichever_way_the_base_looks(create: Robot) -> None:
    told, states = driven(create)
    rows = np.array([0, 30, 110, 260, 1000])
    found = base_velocities(create, states, rows, PERIOD)
    assert found == pytest.approx(told[rows], abs=2e-3)
    wrapped = states.copy()
    wrapped[:, 2] = np.mod(states[:, 2] + np.pi, 2 * np.pi) - np.pi
    assert np.abs(np.diff(wrapped[:, 2])).max() > 6.0
    assert base_velocities(create, wrapped, rows, PERIOD) == pytest.approx(found)


def test_rows_that_were_not_measured_say_nothing(create: Robot) -> None:
    _, states = driven(create)
    holes = states.copy()
    holes[100:120] = np.nan
    found = base_velocities(create, holes, np.array([110, 300]), PERIOD)
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()
    assert base_velocities(load_robot("servo_pendulum"), np.zeros((9, 2)), np.array([3]), PERIOD) is None


def cut_from(create: Robot, terms: Terms, every: int = 50) -> Windows:
    """The windows of a log of a base with an effect, told another speed and yaw rate every so many rows."""
    rng = np.random.default_rng(5)
    told = np.repeat(rng.uniform([0.05, -0.5], [0.3, 0.5], (1500 // every, 2)), every, axis=0)
    told[:40] = 0.0
    run = Run(told[None], initial=np.zeros((1, 3)), period=PERIOD)
    states = rollout(create, create.space.nominal[None], run, terms=terms).states[0, 0]
    values = np.concatenate([states, np.concatenate([told, told[-1:]])], axis=1)
    channels = [Channel(c.name, c.unit) for c in create.file.channels]
    channels += [Channel(a.name, a.unit) for a in create.file.actions]
    log = Recording(tuple(channels), (Episode("drive", PERIOD * np.arange(len(values)), values),))
    return windows(create, log)


def test_windows_cut_while_a_command_is_on_its_way_wait_for_it(create: Robot) -> None:
    """A base that commands reach 0.1 s late turns on as the last one told it, until the next arrives."""
    late = Terms((term("command_delay"),), (np.array([[0.1]]),))
    cut = cut_from(create, late, every=10)  # so that windows begin where a command does
    yaw = lambda run: rollout(create, create.space.nominal[None], run, terms=late).states[0, ..., 2]  # noqa: E731
    apart = np.abs(yaw(cut.run) - cut.measured[..., 2]).max(axis=1)
    assert len(cut) == 3 and apart.max() < 2e-3
    lost = np.abs(yaw(replace(cut.run, before=None)) - cut.measured[..., 2]).max(axis=1)
    assert (lost[1:] > 5 * apart.max()).all()


def test_windows_cut_in_mid_drive_are_replayed_from_the_speed_that_poses_show(create: Robot) -> None:
    """A base with a lag goes on at the speed that it had, and one at rest from rest."""
    lag = Terms((term("drive_inertia"),), (np.array([[0.3]]),))
    cut = cut_from(create, lag)
    assert len(cut) == 3 and cut.run.velocity[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    again = rollout(create, create.space.nominal[None], cut.run, terms=lag).states[0]
    apart = np.hypot(*np.moveaxis((again - cut.measured)[..., :2], -1, 0)).max(axis=1)
    assert apart[0] < 1e-9 and (apart[1:] < 0.01).all()
    still = rollout(
        create, create.space.nominal[None], replace(cut.run, velocity=None, before=None), terms=lag
    )
    lost = np.hypot(*np.moveaxis((still.states[0] - cut.measured)[..., :2], -1, 0)).max(axis=1)
    assert (lost[1:] > 0.02).all()
