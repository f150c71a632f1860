"""The unicycle engine against a fine integration of its equations, and against the kinematic one where they meet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dynreg.errors import RobotError, SimulationError
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

# six parameters each: the two sets known of the Khepera III, a Pioneer with a laser, a wheelchair
SETS = {
    "table_ii": (0.087, 0.101, 1.17e-8, 0.989, 6.00e-6, 0.989),
    "laut": (0.0228, 0.0568, -0.0001, 1.0030, 0.0732, 0.9981),
    "pioneer": (0.2604, 0.2509, -0.000499, 0.9965, 0.00263, 1.0768),
    "wheelchair": (0.3759, 0.0188, 0.0128, 1.0027, -0.0015, 0.9808),
}
NAMES = ("speed_lag", "yaw_lag", "centrifugal", "speed_drag", "coupling", "yaw_drag")
PERIOD = 0.02
X, YAW = slice(4, 6), 6


@pytest.fixture(scope="module")
def diffdrive() -> Robot:
    return load_robot("diffdrive")


def with_base(robot: Robot, **changes: float) -> Robot:
    """The robot with other numbers in [base], and none of them a parameter."""
    base = robot.file.base.model_copy(update=changes)
    file = robot.file.model_copy(update={"base": base})
    return replace(robot, file=file, space=replace(robot.space, parameters=()))


def states(robot: Robot, run: Run, engine: str) -> np.ndarray:
    """(E, T+1, S) of one simulator."""
    return rollout(robot, robot.space.nominal[None], run, engine=engine).states[0]


def integrated(robot: Robot, actions: np.ndarray) -> np.ndarray:
    """(T+1, 5) speed, yaw rate, x, y, yaw by an integrator of high order, command by command."""
    b = robot.file.base
    a1, a2, a3, a4, a5, a6 = (getattr(b, name) for name in NAMES)
    out = [np.zeros(5)]
    for left, right in b.wheel_radius * np.clip(actions, -15.0, 15.0):
        asked, turned = (left + right) / 2, (right - left) / b.track

        def rate(_, s, asked=asked, turned=turned):
            v, w, _, _, yaw = s
            speed_up = (asked - a4 * v + a3 * w**2) / a1
            return [speed_up, (turned - a6 * w - a5 * v * w) / a2, v * np.cos(yaw), v * np.sin(yaw), w]

        out.append(solve_ivp(rate, (0, PERIOD), out[-1], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1])
    return np.array(out)


@pytest.mark.parametrize("name", SETS)
def test_it_is_the_integral_of_the_six_parameters(name: str, diffdrive: Robot):
    robot = with_base(diffdrive, **dict(zip(NAMES, SETS[name], strict=True)))
    run = excitation(robot, seed=0, episodes=1, steps=100)
    made, exact = states(robot, run, "unicycle")[0], integrated(robot, run.actions[0])
    np.testing.assert_allclose(
        made[:, 4:], exact[:, 2:], atol=1e-4
    )  # m, rad after 2 s at time steps of 10 ms
    b = robot.file.base
    turn = exact[:, 1] * b.track / 2
    wheels = np.stack([exact[:, 0] - turn, exact[:, 0] + turn], axis=1) / b.wheel_radius
    np.testing.assert_allclose(made[:, 2:4], wheels, atol=0.02)  # of up to 15 rad/s
    assert np.ptp(made[:, X], axis=0).max() > 0.02 and np.ptp(made[:, YAW]) > 1.0


def test_the_error_falls_with_the_fourth_power_of_the_time_step(diffdrive: Robot):
    robot = with_base(diffdrive, centrifugal=0.002, coupling=0.5)
    run = excitation(robot, seed=1, episodes=1, steps=50)
    exact = integrated(robot, run.actions[0])[:, 2:]
    errors = []
    for step in (0.02, 0.01, 0.005):
        table = robot.file.robot.model_copy(update={"timestep": step})
        coarse = replace(robot, file=robot.file.model_copy(update={"robot": table}))
        errors.append(np.abs(states(coarse, run, "unicycle")[0][:, 4:] - exact).max())
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


def test_without_couplings_it_is_the_kinematic_engine_with_lags(diffdrive: Robot):
    run = excitation(diffdrive, seed=2, episodes=4, steps=100)
    for lag in (0.02, 0.087, 0.3):
        robot = with_base(diffdrive, speed_lag=lag, yaw_lag=1.2 * lag, centrifugal=0.0, coupling=0.0)
        one, other = (states(robot, run, engine) for engine in ("kinematic", "unicycle"))
        np.testing.assert_allclose(other, one, atol=2e-3 if lag > 0.05 else 2e-2)


def test_lags_that_vanish_leave_the_bare_kinematics(diffdrive: Robot):
    """Arcs of the commanded speeds, as in the closed form; a lag of 1 ms is 1 ms late, and no more."""
    robot = with_base(diffdrive, speed_lag=0.0, yaw_lag=0.0, speed_drag=1.0, yaw_drag=1.0, coupling=0.0)
    actions = np.tile([4.0, 7.0], (1, 100, 1))
    bare = states(robot, Run(actions), "kinematic")[0]
    b, t = robot.file.base, np.arange(101) * PERIOD
    v, w = b.wheel_radius * 5.5, b.wheel_radius * 3.0 / b.track
    arc = np.stack([v / w * np.sin(w * t), v / w * (1 - np.cos(w * t)), w * t], axis=1)
    np.testing.assert_allclose(bare[:, 4:], arc, atol=1e-9)
    np.testing.assert_allclose(bare[:, :2], np.outer(t, [4.0, 7.0]), atol=1e-9)
    short = with_base(robot, speed_lag=0.001, yaw_lag=0.001)
    quick = states(short, Run(actions), "unicycle")[0]
    np.testing.assert_allclose(quick[1:, YAW], arc[1:, 2] - 0.001 * w, atol=1e-5)


def test_simulators_are_independent_of_each_other(diffdrive: Robot):
    run = excitation(diffdrive, seed=3, episodes=3, steps=30)
    values = diffdrive.space.sample(0, 5, 0)
    together = rollout(diffdrive, values, run, engine="unicycle").states
    alone = rollout(diffdrive, values[3:4], run.take(np.array([1])), engine="unicycle").states
    np.testing.assert_array_equal(together[3:4, 1:2], alone)


def test_a_known_start_is_taken_and_the_speeds_of_wheels_are_the_base_s(diffdrive: Robot):
    initial = np.array([[3.0, -2.0, 5.0, 8.0, 0.4, -0.1, 1.0]])
    run = Run(np.tile([5.0, 8.0], (1, 5, 1)), initial=initial)
    for engine in ("kinematic", "unicycle"):
        made = states(diffdrive, run, engine)[0]
        np.testing.assert_allclose(made[0], initial[0], atol=1e-12)
        np.testing.assert_allclose(made[-1, 2:4], [5.0, 8.0], rtol=0.02)
        np.testing.assert_allclose(made[-1, :2] - initial[0, :2], [0.5, 0.8], rtol=0.02)


def test_a_base_without_lags_is_refused(diffdrive: Robot):
    robot = with_base(diffdrive, yaw_lag=0.0)
    with pytest.raises(SimulationError, match=r"lag of 0 s.*0.001 s.*kinematic engine"):
        states(robot, Run(np.ones((1, 2, 2))), "unicycle")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'left = "left_wheel"',
            'left = "wheel"',
            r"line \d+: no action 'wheel/velocity_command'.*left wheel",
        ),
        ("track = 0.0884", "track = -1.0", "track.*greater than 0"),
        ('name = "base/x"', 'name = "left_wheel/x"', "channel 'left_wheel/x' is not of a planar base"),
        ('"port.base.track ="', '"port.base.width ="', "names 'width'.*track"),
        ("port.base.track =", "mj.body_mass[base] =", "a planar base has no such field"),
    ],
)
def test_what_is_no_base_on_wheels_is_refused(
    old: str, new: str, said: str, tmp_path: Path, diffdrive: Robot
):
    text = (diffdrive.folder / "robot.toml").read_text()
    assert old in text
    (tmp_path / "robot.toml").write_text(text.replace(old, new))
    (tmp_path / "model.xml").write_text((diffdrive.folder / "model.xml").read_text())
    with pytest.raises((RobotError, SimulationError), match=said):
        robot = load_robot(tmp_path)
        rollout(robot, robot.space.nominal[None], Run(np.zeros((1, 2, 2))))


def test_a_robot_without_wheels_has_no_port_of_a_base(tmp_path: Path):
    husky = load_robot("husky")
    text = (husky.folder / "robot.toml").read_text()
    text = text.replace("port.drive.lag[base/speed_command] =", "port.base.speed_lag =")
    (tmp_path / "robot.toml").write_text(text)
    (tmp_path / "model.xml").write_text((husky.folder / "model.xml").read_text())
    robot = load_robot(tmp_path)
    with pytest.raises(RobotError, match=r"no base on wheels.*\[base\] table"):
        rollout(robot, robot.space.nominal[None], Run(np.zeros((1, 2, 2))))
