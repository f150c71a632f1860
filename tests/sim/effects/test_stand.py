"""A stand that gives: MuJoCo's own hinge and spring under the robot must do the same."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from wired import wired

from dynreg.errors import SimulationError
from dynreg.sim.effects import Terms, effects, term
from dynreg.sim.effects.stand import LOSS
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

JOINTS = ("shoulder", "elbow")
GAIN, RATE_GAIN, RATE, STEP = 120.0, 6.0, 50.0, 0.001
AT, START = (0.1, 0.0, 0.3), (0.5, -0.8)
COMPLIANCE = 0.001  # rad/(N m)
STAND = effects()["stand_compliance"]


def model_text(stand: str = "", close: str = "", where: tuple = AT, key: str = "0.5 -0.8") -> str:
    """Two links on a base that is fixed to the ground and reaches into it; with `stand` around the base."""
    links = ""
    for name in JOINTS:
        links += f'<body name="{name}" pos="0 0 0.2"><joint name="{name}" axis="0 1 0"/>'
        links += '<inertial mass="2" pos="0 0 0.2" diaginertia="0.02 0.02 0.002"/>'
    motors = "".join(f'<position name="{n}" joint="{n}"/>' for n in JOINTS)
    place = " ".join(map(str, where))
    base = f'<body name="base" pos="{place}"><geom type="box" size=".1 .1 .31" mass="3"/>'
    return (
        f'<mujoco><option timestep="{STEP}"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>'
        f"{stand}{base}{links}{'</body>' * 3}{close}</worldbody><actuator>{motors}</actuator>"
        f'<keyframe><key name="start" qpos="{key}"/></keyframe></mujoco>'
    )


def made(path: Path, engines: str = '["mujoco"]') -> Robot:
    (path / "model.xml").write_text(model_text(), encoding="utf-8")
    toml = f'[robot]\nname = "arm"\nengines = {engines}\ncontrol_rate = {RATE}\ntimestep = {STEP}\n'
    toml += '[reset]\nkeyframe = "start"\n'
    (path / "robot.toml").write_text(toml + wired(JOINTS, GAIN, RATE_GAIN), encoding="utf-8")
    return load_robot(path)


def targets() -> np.ndarray:
    """(T, 2): quick steps of both joints."""
    return np.array([[0.5, -0.8], [1.1, -0.2], [0.2, -1.0], [0.5, 0.3]]).repeat(20, axis=0)


def by_hand(compliance: float) -> np.ndarray:
    """(T+1, 2) what MuJoCo makes of a sprung hinge under the base, from where the weight holds it."""
    damping = 2 * LOSS * np.sqrt(_inertia() / compliance)
    place = " ".join(map(str, AT))
    stand = (
        f'<body pos="{place}"><inertial mass="1e-6" pos="0 0 0" diaginertia="1e-6 1e-6 1e-6"/>'
        f'<joint name="give" axis="0 1 0" stiffness="{1 / compliance}" damping="{damping}"/>'
    )
    text = model_text(stand, "</body>", (0, 0, 0), "0 0.5 -0.8").replace(
        'size=".1 .1 .31"', 'size=".1 .1 .31" contype="0" conaffinity="0"'
    )
    spec = mujoco.MjSpec.from_string(text)
    for one in spec.actuators:
        one.set_to_position(kp=GAIN, kv=RATE_GAIN)
    model = spec.compile()
    data, out = mujoco.MjData(model), []
    data.qpos[:] = [0.0, *START]
    for _ in range(30):
        mujoco.mj_forward(model, data)
        data.qpos[0] = -data.qfrc_bias[0] * compliance
    for target in targets():
        data.ctrl[:] = target
        out.append(data.qpos[1:].copy())
        mujoco.mj_step(model, data, nstep=round(1 / (RATE * STEP)))
    return np.array([*out, data.qpos[1:]])


def _inertia() -> float:
    """[kg m^2] about the base's origin at the start: three bodies in the plane, by hand."""
    first, second = START[0], START[0] + START[1]
    elbow = np.array(
        [0.2 * np.sin(first), 0.2 + 0.2 * np.cos(first)]
    )  # where the first link's centre lies, too
    two = elbow + 0.2 * np.array([np.sin(second), np.cos(second)])
    box = 3 / 3 * (0.1**2 + 0.31**2)
    return float(box + 2 * (elbow @ elbow + two @ two) + 2 * 0.02)


def by_effect(robot: Robot, compliance: float) -> np.ndarray:
    terms = Terms((term("stand_compliance"),), (np.array([[compliance]]),))
    return rollout(robot, robot.space.nominal[None], Run(targets()[None]), terms=terms).states[0, 0]


def test_it_is_a_sprung_hinge_under_the_base(tmp_path: Path) -> None:
    robot = made(tmp_path)
    plain = rollout(robot, robot.space.nominal[None], Run(targets()[None])).states[0, 0]
    mine, theirs = by_effect(robot, COMPLIANCE), by_hand(COMPLIANCE)
    assert np.abs(theirs - plain).max() > 0.1
    np.testing.assert_allclose(mine, theirs, atol=1e-6)


def test_a_stand_that_hardly_gives_is_none_and_stays_stable(tmp_path: Path) -> None:
    robot = made(tmp_path)
    plain = rollout(robot, robot.space.nominal[None], Run(targets()[None])).states[0, 0]
    moved = [np.abs(by_effect(robot, compliance) - plain).max() for compliance in (1e-4, 1e-6, 1e-8)]
    assert 0.03 > moved[0] > 50 * moved[1] > 1e3 * moved[2] > 0


def test_simulators_with_and_without_it_do_not_touch_each_other(tmp_path: Path) -> None:
    robot = made(tmp_path)
    some = Terms(
        (term("stand_compliance"),), (np.array([[np.nan], [COMPLIANCE], [np.nan], [COMPLIANCE / 4]]),)
    )
    values, run = np.tile(robot.space.nominal, (4, 1)), Run(targets()[None])
    made_together = rollout(robot, values, run, terms=some).states[:, 0]
    np.testing.assert_array_equal(made_together[1], by_effect(robot, COMPLIANCE))
    np.testing.assert_array_equal(made_together[3], by_effect(robot, COMPLIANCE / 4))
    plain = rollout(robot, values[:1], run).states[0, 0]
    np.testing.assert_array_equal(made_together[0], plain)
    np.testing.assert_array_equal(made_together[2], plain)
    with pytest.raises(SimulationError, match="with and without an effect that makes another model"):
        Arena(robot, values, run, terms=some)


@pytest.mark.parametrize(
    "robot, why",
    [
        ("quadruped", "its base floats"),
        ("leg", "its base moves"),
        ("servo_pendulum", "an engine of the robot moves each joint alone"),
        ("diffdrive", "no servo whose stiffness could be compared"),
        ("emps", "no servo whose stiffness could be compared"),
    ],
)
def test_where_there_is_no_stand_that_could_give_it_says_why(robot: str, why: str) -> None:
    assert STAND.why_not(load_robot(robot)) == why
