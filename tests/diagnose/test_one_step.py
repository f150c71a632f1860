"""One step ahead the true simulator leaves nothing, and a wrong one what its cause does to the acceleration."""

import numpy as np
import pytest
from motions import windows_of

from dynreg.diagnose.one_step import one_step_residuals, one_step_run
from dynreg.diagnose.residual_fit import fit_residual
from dynreg.errors import UsageError
from dynreg.replay.windows import Windows
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot

VISCOUS = "viscous_friction"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def values(robot: Robot, **given: float) -> np.ndarray:
    """(1, P) the nominal robot with some parameters given."""
    return robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | given)[None]


def measured(robot: Robot, true: np.ndarray, noise: float = 0.0) -> Windows:
    """What a robot with true values (1, P) did, on a log that began at 5 s."""
    run = excitation(robot, seed=2, name="one step", episodes=10, steps=100)
    states = rollout(robot, true, run, engine="joint", threads=1).states[0]
    states = states + noise * np.random.default_rng(0).standard_normal(states.shape)
    begin = 5.0 + 1.5 * np.arange(10)
    return windows_of(robot, states, run.actions, inputs=run.inputs, settings=run.settings, begin=begin)


def predicted(robot: Robot, windows: Windows, guess: np.ndarray) -> np.ndarray:
    states = rollout(robot, guess, one_step_run(robot, windows), engine="joint", threads=1).states
    return states[0, :, 1].reshape(len(windows), windows.run.steps, -1)


def test_every_row_is_a_start_of_its_own(robot):
    windows = measured(robot, values(robot))
    run = one_step_run(robot, windows)
    assert run.actions.shape == (1000, 1, 1) and run.steps == 1 and run.period == windows.period
    at = 3 * 100 + 42
    np.testing.assert_array_equal(run.initial[at], windows.measured[3, 42])
    np.testing.assert_array_equal(run.actions[at, 0], windows.run.actions[3, 42])
    np.testing.assert_array_equal(run.inputs[at, 0], windows.run.inputs[3, 42])
    np.testing.assert_array_equal(run.settings[at], windows.run.settings[3])
    assert run.begin[at] == pytest.approx(5.0 + 4.5 + 0.42)


def test_the_true_simulator_leaves_nothing(robot):
    windows = measured(robot, values(robot))
    (found,) = one_step_residuals(robot, windows, predicted(robot, windows, values(robot)))
    assert found.joint == "arm" and found.unit == "rad/s^2"
    assert np.abs(found.values).max() < 1e-8
    assert set(found.signals) >= {
        "position",
        "velocity",
        "sign_of_velocity",
        "load",
        "command_error",
        "time",
        "kp",
    }
    np.testing.assert_array_equal(found.trajectory, np.repeat(np.arange(10), 100))
    assert found.signals["time"][100] == pytest.approx(6.5)


@pytest.mark.parametrize("logged", [True, False], ids=["velocities", "positions only"])
def test_friction_that_the_simulator_lacks_depends_on_velocity(robot, logged):
    windows = measured(robot, values(robot, viscous_friction=0.02), noise=0.0)
    if not logged:
        windows.measured[..., 1] = np.nan
    (found,) = one_step_residuals(robot, windows, predicted(robot, windows, values(robot)))
    v, lost = found.signals["velocity"], found.values
    known = np.isfinite(lost) & (np.abs(v) > 0.5)
    inertia = 0.0018 + 0.49 * 0.1**2  # rotor and tip of the bench
    slope = np.polyfit(v[known], lost[known], 1)[0]
    assert slope == pytest.approx(-(0.02 - 0.006) / inertia, rel=0.15)
    told = fit_residual(found)
    assert told.rows[0].signal == "velocity" and told.rows[0].share > 0.8
    assert np.isfinite(lost).sum() == (
        1000 if logged else 990
    )  # the first row of a window has none before it


def test_positions_alone_leave_nothing_of_the_true_simulator_either(robot):
    windows = measured(robot, values(robot, coulomb_friction=0.002))
    windows.measured[..., 1] = np.nan
    made = predicted(robot, windows, values(robot, coulomb_friction=0.002))
    (found,) = one_step_residuals(robot, windows, made)
    q = windows.measured[..., 0]
    acceleration = np.diff(q, n=2, axis=1) / windows.period**2
    typical = np.nanmedian(np.abs(found.values))
    assert typical < 0.02 * np.median(np.abs(acceleration))


@pytest.mark.parametrize("logged", [True, False], ids=["velocities", "positions only"])
def test_what_sensors_do_to_the_true_simulator_is_no_cause(robot, logged):
    """The noise of a row is in its residual and in its signals: that must not read as a dependence."""
    windows = measured(robot, values(robot))
    noise, quantum = (np.array([getattr(c, k) for c in robot.file.channels]) for k in ("noise", "quantum"))
    noisy = windows.measured + noise * np.random.default_rng(1).standard_normal(windows.measured.shape)
    windows.measured[:] = quantum * np.round(noisy / quantum)
    if not logged:
        windows.measured[..., 1] = np.nan
    (found,) = one_step_residuals(robot, windows, predicted(robot, windows, values(robot)))
    told = fit_residual(found)
    assert told.explained == 0 and told.size > 1.0


def test_rows_that_were_not_measured_leave_no_residual(robot):
    windows = measured(robot, values(robot))
    windows.measured[2, 30:40] = np.nan
    made = predicted(robot, windows, values(robot))
    (found,) = one_step_residuals(robot, windows, made)
    gone = np.flatnonzero(np.isnan(found.values))
    np.testing.assert_array_equal(gone, 200 + np.arange(29, 40))
    assert np.nanmax(np.abs(found.values)) < 1e-8


def test_predictions_of_other_windows_are_refused(robot):
    windows = measured(robot, values(robot))
    with pytest.raises(UsageError, match=r"shape \(10, 101, 2\); expected \(10, 100, 2\)"):
        one_step_residuals(robot, windows, windows.measured)
