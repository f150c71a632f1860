"""Stops of the joint engine: a joint that presses on one, or is thrown at it, does what it does in MuJoCo."""

from pathlib import Path

import numpy as np
import pytest

from dynreg.sim.engines import rollout
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

XML = """
<mujoco>
  <compiler angle="radian"/>
  <option integrator="implicitfast"/>
  <worldbody><body><joint name="arm" axis="0 1 0" range="-0.4 0.5" damping="0.05" frictionloss="0.02" {stops}/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.4"/></body></worldbody>
  <actuator><position joint="arm" kp="20" kv="0.5"/></actuator>
</mujoco>
"""
TOML = """
[robot]
name = "stopped"
engines = ["joint", "mujoco"]
control_rate = 100.0
timestep = 0.0001
[[drives]]
joint = "arm"
type = "position"
gain = 20.0
rate_gain = 0.5
torque_limit = 6.0
[[actions]]
name = "arm/target"
unit = "rad"
[[channels]]
name = "arm/position"
unit = "rad"
[[channels]]
name = "arm/velocity"
unit = "rad/s"
[[parameters]]
name = "reach"
unit = "1"
nominal = 1.0
low = 0.5
high = 1.2
sets = ["mj.jnt_range[arm] *="]
"""
STOPS = {
    "usual": "",
    "soft": 'solreflimit="0.05 0.3" solimplimit="0.5 0.99 0.02 0.3 3"',
    "by stiffness": 'solreflimit="-3000 -60"',
    "early": 'margin="0.05"',
}


@pytest.mark.parametrize("kind", STOPS)
def test_a_stop_pushes_as_mujocos_does(kind: str, tmp_path: Path):
    (tmp_path / "model.xml").write_text(XML.format(stops=STOPS[kind]))
    (tmp_path / "robot.toml").write_text(TOML)
    robot = load_robot(tmp_path)
    t = np.arange(120) / 100
    run = Run(np.stack([0.9 * np.sin(5 * t), np.where(t < 0.5, 0.8, -1.2)])[..., None])
    values = np.array([[1.0], [0.6]])  # stops of their own
    joint, mujoco = (rollout(robot, values, run, engine=e).states[..., 0] for e in ("joint", "mujoco"))
    np.testing.assert_allclose(joint, mujoco, atol=3e-3)  # one is late by a time step, at up to 12 rad/s
    assert np.all(joint.max(axis=-1) > 0.8 * values * 0.5) and np.all(joint[:, 1].max(axis=-1) < 0.8)
    wide = rollout(robot, values * 10, run, engine="joint").states[..., 0]
    assert np.all(np.abs(wide - joint).max(axis=-1) > 0.1), "nothing pressed on a stop"
