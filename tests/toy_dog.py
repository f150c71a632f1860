"""A robot dog with an ERS-210's legs, on the ground or held, and with a ball where one is asked for."""

from pathlib import Path

ENDS = {
    "f": (0.065, 0.06543, -4.4),
    "r": (-0.065, 0.06765, -11.5),
}  # x of the hip [m], lower leg [m], its angle [deg]
SIDES = {"l": 1.0, "r": -1.0}
ROTOR, ELEVATOR, KNEE = (-130, 115), (-10, 88), (-25, 122)  # deg
STANCE = {"rotor": -35, "elevator": 6, "knee": 75}  # deg
JOINTS = [f"{end}{side}_{role}" for end in ENDS for side in SIDES for role in STANCE]


def _leg(end: str, side: str) -> str:
    import math

    (x, lower, lean), left = ENDS[end], SIDES[side]
    ahead, down = lower * math.sin(math.radians(lean)), -lower * math.cos(math.radians(lean))
    turns = 1 if end == "f" else -1  # the rear rotor is mirrored, and its knee bends the other way
    name = f"{end}{side}"
    return f"""
      <body name="{name}_shoulder" pos="{x} {left * 0.0625} 0">
        <joint name="{name}_rotor" axis="0 {-turns} 0" range="{ROTOR[0]} {ROTOR[1]}"/>
        <inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
        <body name="{name}_upper">
          <joint name="{name}_elevator" axis="{left} 0 0" range="{ELEVATOR[0]} {ELEVATOR[1]}"/>
          <geom type="capsule" size="0.01" fromto="0 0 0 0 {left * 0.009} -0.0695" mass="0.073"/>
          <body name="{name}_lower" pos="0 {left * 0.009} -0.0695">
            <joint name="{name}_knee" axis="0 {-turns} 0" range="{KNEE[0]} {KNEE[1]}"/>
            <geom type="capsule" size="0.008" fromto="0 0 0 {turns * ahead} 0 {down}" mass="0.073"/>
            <geom name="{name}_foot" type="sphere" size="0.013" pos="{turns * ahead} 0 {down}" contype="1" mass="0"/>
          </body>
        </body>
      </body>"""


def model(ball: bool = False) -> str:
    legs = "".join(_leg(end, side) for end in ENDS for side in SIDES)
    pose = " ".join(f"{STANCE[name.split('_')[1]] * 0.017453292519943295:.9g}" for name in JOINTS)
    drives = "".join(f'<general name="{name}" joint="{name}" biastype="affine"/>' for name in JOINTS)
    toy = '<body name="ball" pos="0.125 0.081 0.03"><freejoint name="ball"/>'
    toy += '<geom type="sphere" size="0.03" mass="0.02" contype="3" conaffinity="3"/></body>'
    return f"""<mujoco model="dog">
  <compiler angle="degree" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <joint damping="0.01" armature="0.001"/>
    <geom contype="0" conaffinity="{2 if ball else 0}" friction="0.9 0.005 0.0001" solref="0.008 1"/>
  </default>
  <worldbody>
    <geom name="ground" type="plane" size="5 5 0.1" conaffinity="1"/>
    <body name="trunk" pos="0 0 0.14">
      <freejoint name="base"/>
      <geom type="box" size="0.08 0.045 0.03" mass="0.85"/>{legs}
    </body>{toy if ball else ""}
  </worldbody>
  <actuator>{drives}</actuator>
  <keyframe><key name="stance" qpos="0 0 0.14 1 0 0 0 {pose}{" 0.125 0.081 0.03 1 0 0 0" if ball else ""}"/></keyframe>
</mujoco>"""


def robot_toml(gait: str, more: str = "", tracked: str = "") -> str:
    table = lambda head, **keys: "\n".join([f"[[{head}]]", *(f"{k} = {v}" for k, v in keys.items()), ""])  # noqa: E731
    text = f"""
[robot]
name = "dog"
model = "model.xml"
engines = ["mujoco"]
control_rate = 62.5
timestep = 0.002
{tracked}
[reset]
keyframe = "stance"
settle = 0.3
[fall]
tilt = 1.0
height = 0.04
[[drives]]
joint = "*"
type = "position"
gain = 15.0
rate_gain = 0.15
torque_limit = 2.0
speed_limit = 12.0
{gait}
{more}
"""
    for name in JOINTS:
        text += table("actions", name=f'"{name}/target"', unit='"rad"')
    for name in JOINTS:
        text += table("channels", name=f'"{name}/position"', unit='"rad"')
    sets = '["mj.geom_friction[*_foot][0] ="]'
    return text + table(
        "parameters", name='"friction"', unit='"1"', nominal=0.9, low=0.4, high=1.2, sets=sets
    )


def walking(start: str = "") -> str:
    """[gait] by the way of the feet, and a task."""
    text = '[gait]\nkind = "locus"\nramp = 0.5\n' + start
    text += "".join(f'[[gait.roles]]\nname = "{role}"\n' for role in STANCE)
    for name in ("fl", "fr", "rl", "rr"):
        joints = ", ".join(f'{role} = "{name}_{role}"' for role in STANCE)
        text += f'[[gait.legs]]\nname = "{name}"\njoints = {{ {joints} }}\n'
    return text + '[[tasks]]\nname = "forward"\nseconds = 10.0\n'


def folder(path: Path, gait: str, more: str = "", ball: bool = False) -> Path:
    """The robot's folder, made at `path`."""
    path.mkdir(parents=True)
    (path / "model.xml").write_text(model(ball), encoding="utf-8")
    tracked = 'tracked = ["ball"]' if ball else ""
    (path / "robot.toml").write_text(robot_toml(gait, more, tracked), encoding="utf-8")
    return path
