"""A robot of one arm that swings from a keyframe, with an actuator as a test wants it."""

from pathlib import Path

from dynreg.sim.robot import Robot, load_robot

_MODEL = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="arm" axis="0 1 0" armature="0.02"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.2" mass="0.3" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
  <keyframe><key name="start" {start}/></keyframe>
</mujoco>"""
_TOML = """
[robot]
name = "one_arm"
engines = ["mujoco", "joint"]
control_rate = 50.0
timestep = 0.002

[reset]
keyframe = "start"
settle = {settle}

[[drives]]
joint = "arm"
type = "position"
gain = 10.0
rate_gain = 0.5
torque_limit = 3.0

[[actions]]
name = "arm/target"
unit = "rad"

[[channels]]
name = "arm/position"
unit = "rad"
noise = 0.0005

[[channels]]
name = "arm/velocity"
unit = "rad/s"
noise = 0.02

[[parameters]]
name = "gain"
unit = "1"
nominal = 1.0
low = 0.5
high = 1.5
sets = ["port.drive.gain_factor *="]
"""


def model_of(actuator: str, start: str) -> str:
    """The MJCF. start : attributes of the keyframe."""
    return _MODEL.format(actuator=actuator, start=start)


def written(folder: Path, model: str, settle: float = 0.0) -> Robot:
    """The robot, in a folder that is there."""
    (folder / "model.xml").write_text(model, encoding="utf-8")
    (folder / "robot.toml").write_text(_TOML.format(settle=settle), encoding="utf-8")
    return load_robot(folder)
