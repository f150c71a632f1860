"""A motor that turns with two joints: MuJoCo's own friction along a tendon over both must do the same."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from wired import wired

from dynreg.errors import UsageError
from dynreg.sim.effects import Terms, effects, placed, term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

JOINTS = ("bend", "turn", "roll")
GAIN, RATE_GAIN, RATE, STEP = 30.0, 1.0, 50.0, 0.001
COUPLING = effects()["cable_coupling"]


def model_text(tendon: str = "") -> str:
    text = ""
    for name, axis in zip(JOINTS, ("0 1 0", "0 1 0", "0 0 1"), strict=True):
        text += f'<body name="{name}" pos="0 0 0.2"><joint name="{name}" axis="{axis}" armature="0.02"/>'
        text += '<inertial mass="0.6" pos="0.05 0 0.1" diaginertia="0.004 0.004 0.002"/>'
    motors = "".join(f'<position name="{n}" joint="{n}" kp="{GAIN}" kv="{RATE_GAIN}"/>' for n in JOINTS)
    return (
        f'<mujoco><option timestep="{STEP}"/><worldbody>{text}{"</body>" * 3}</worldbody>'
        f"{tendon}<actuator>{motors}</actuator></mujoco>"
    )


def made(path: Path, engines: str = '["mujoco"]') -> Robot:
    (path / "model.xml").write_text(model_text(), encoding="utf-8")
    toml = f'[robot]\nname = "wrist"\nengines = {engines}\ncontrol_rate = {RATE}\ntimestep = {STEP}\n'
    (path / "robot.toml").write_text(toml + wired(JOINTS, GAIN, RATE_GAIN), encoding="utf-8")
    return load_robot(path)


def targets() -> np.ndarray:
    """(T, 3): both joints together, then against each other, then one alone."""
    time = np.arange(150) / RATE
    wave = 0.6 * np.sin(2 * np.pi * time)
    first, second = np.where(time < 2, wave, 0.0), np.where(time < 1, wave, np.where(time < 2, -wave, wave))
    return np.stack([0.2 * np.sin(4 * time), first, second], axis=1)


def by_tendon(way: float, torque: float, coefficient: float) -> np.ndarray:
    """(T+1, 3) what MuJoCo makes of it with friction along a tendon over both joints."""
    tendon = (
        f'<tendon><fixed frictionloss="{torque}" damping="{coefficient}" solreffriction="0.002 1">'
        f'<joint joint="turn" coef="1"/><joint joint="roll" coef="{way}"/></fixed></tendon>'
    )
    model = mujoco.MjModel.from_xml_string(model_text(tendon))
    data, out = mujoco.MjData(model), []
    for target in targets():
        data.ctrl[:] = target
        out.append(data.qpos.copy())
        mujoco.mj_step(model, data, nstep=round(1 / (RATE * STEP)))
    return np.array([*out, data.qpos])


def by_effect(
    robot: Robot, torque: float, coefficient: float, key: str = "cable_coupling[turn,roll]"
) -> np.ndarray:
    terms = Terms((term(key),), (np.array([[torque, coefficient]]),))
    return rollout(robot, robot.space.nominal[None], Run(targets()[None]), terms=terms).states[0, 0]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_it_is_friction_along_a_tendon_over_both_joints(way: float, tmp_path: Path) -> None:
    robot = made(tmp_path)
    mine, theirs = by_effect(robot, way * 0.8, 0.4), by_tendon(way, 0.8, 0.4)
    plain, other = by_effect(robot, 1e-9, 0.0), by_effect(robot, -way * 0.8, 0.4)
    moved = np.abs(theirs - plain).max()
    assert moved > 0.05
    assert np.abs(mine - theirs).max() < 0.06 * moved < 0.3 * np.abs(other - theirs).max()


def test_it_is_looked_for_between_neighbours_only(tmp_path: Path) -> None:
    robot = made(tmp_path)
    assert [one.key for one in placed(robot, COUPLING)] == [
        "cable_coupling[bend,turn]",
        "cable_coupling[turn,roll]",
    ]
    for key in ("cable_coupling", "cable_coupling[bend,roll]", "cable_coupling[roll,turn]"):
        with pytest.raises(UsageError, match="expected two neighbours, one of 'bend,turn', 'turn,roll'"):
            by_effect(robot, 0.1, 0.0, key)


def test_where_joints_move_alone_nothing_couples_them(tmp_path: Path) -> None:
    assert (
        COUPLING.why_not(made(tmp_path, '["joint", "mujoco"]'))
        == "an engine of the robot moves each joint alone"
    )
    assert COUPLING.why_not(load_robot("servo_pendulum")) == "no joint that is driven hangs on another"
    assert COUPLING.why_not(load_robot("diffdrive")) is not None
    assert len(placed(load_robot("quadruped"), COUPLING)) == 8
