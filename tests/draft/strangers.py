"""Small models as strangers write them, one for each thing that a draft must cope with."""

from pathlib import Path

from dynreg.data.series import RawLog
from dynreg.draft.draft import draft_robot
from dynreg.draft.entry import Drafted, DraftOptions, Notes
from dynreg.draft.source import read_source

ARM = """
<mujoco model="arm">
  <compiler angle="degree"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 0.5">
      <joint name="shoulder" axis="0 1 0" range="-90 90" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.4"/>
      <body name="fore" pos="0.2 0 0">
        <joint name="elbow" axis="0 1 0" range="-90 90" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.015" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  {actuators}
</mujoco>
"""
POSITION = """<actuator>
    <position joint="shoulder" kp="40" kv="1" forcerange="-8 8"/><position joint="elbow" kp="20" kv="0.5"/>
  </actuator>"""
MOTOR = """<actuator>
    <motor joint="shoulder" gear="5" ctrlrange="-1 1"/><motor joint="elbow" ctrlrange="-2 2"/>
  </actuator>"""
VELOCITY = """<actuator>
    <velocity joint="shoulder" kv="3" ctrlrange="-2 2"/><velocity joint="elbow" kv="2" ctrlrange="-2 2"/>
  </actuator>"""
GENERAL = """<actuator>
    <general joint="shoulder" gainprm="0.2" biastype="affine" biasprm="0 -20 -1" ctrlrange="-100 100"/>
    <general joint="elbow" gear="2" gainprm="5" biastype="affine" biasprm="0 -5 -0.5"/>
  </actuator>"""
GEARED = """<actuator>
    <position joint="shoulder" gear="10" kp="0.4" kv="0.01"/><position joint="elbow" gear="10" kp="0.2" kv="0.005"/>
  </actuator>"""
CURRENT = """<actuator>
    <dcmotor joint="shoulder" gear="20" motorconst="0.05" resistance="2"/>
    <dcmotor joint="elbow" gear="10" motorconst="0.05" resistance="2"/>
  </actuator>"""

_LEG = """
      <body name="{name}_thigh" pos="{x} {y} 0">
        <joint axis="0 1 0" range="-1.5 1.5" damping="0.1" armature="0.005"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.12" size="0.012" mass="0.15" contype="0" conaffinity="0"/>
        <body name="{name}_shank" pos="0 0 -0.12">
          <joint axis="0 1 0" range="-2.5 0.5" damping="0.1" armature="0.005"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.12" size="0.01" mass="0.1" contype="0" conaffinity="0"/>
          <geom type="sphere" pos="0 0 -0.12" size="0.015" mass="0.01"/>
        </body>
      </body>"""
_LEGS = [
    (f"{end}{side}", x, y) for end, x in (("f", 0.15), ("r", -0.15)) for side, y in (("l", 0.1), ("r", -0.1))
]
QUADRUPED = f"""
<mujoco model="dog">
  <compiler angle="radian"/>
  <worldbody>
    <body pos="0 0 0.3">
      <freejoint/>
      <geom type="box" size="0.16 0.08 0.03" mass="3"/>
      {"".join(_LEG.format(name=name, x=x, y=y) for name, x, y in _LEGS)}
    </body>
  </worldbody>
  <actuator>
    {{actuators}}
  </actuator>
</mujoco>
"""
CART = """
<mujoco model="cart">
  <option integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="chassis" pos="0 0 0.06">
      <freejoint/>
      <geom type="box" size="0.12 0.08 0.02" mass="2"/>
      <geom type="sphere" pos="0.1 0 -0.04" size="0.02" mass="0.05" friction="0.01 0.005 0.0001"/>
      <body name="left" pos="-0.05 0.1 -0.01"><joint name="left_wheel" axis="0 1 0" damping="0.01"/>
        <geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.2"/></body>
      <body name="right" pos="-0.05 -0.1 -0.01"><joint name="right_wheel" axis="0 1 0" damping="0.01"/>
        <geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.2"/></body>
    </body>
  </worldbody>
  <actuator>
    <velocity joint="left_wheel" kv="0.5" ctrlrange="-10 10" forcerange="-2 2"/>
    <velocity joint="right_wheel" kv="0.5" ctrlrange="-10 10" forcerange="-2 2"/>
  </actuator>
</mujoco>
"""
SLIDER = """
<mujoco model="slider">
  <worldbody>
    <body name="carriage"><joint name="rail" type="slide" axis="1 0 0" range="-0.5 0.5" frictionloss="1"/>
      <geom type="box" size="0.1 0.1 0.1" mass="2"/></body>
  </worldbody>
  <actuator><position joint="rail" kp="400" kv="30"/></actuator>
</mujoco>
"""
CARTPOLE = """
<mujoco model="cartpole">
  <option timestep="0.01" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <body name="cart" pos="0 0 1">
      <joint name="slider" type="slide" axis="1 0 0" range="-1.8 1.8" damping="0.0005"/>
      <geom type="box" size="0.2 0.15 0.1" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.000002"/>
        <geom type="capsule" fromto="0 0 0 0 0 1" size="0.045" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slider" gear="10" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
URDF = """<?xml version="1.0"?>
<robot name="two_link">
  <link name="base_link"/>
  <link name="upper_link">
    <inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
      <inertia ixx="0.001" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://two_link_description/meshes/upper.dae"/></geometry></visual>
    <collision><geometry><mesh filename="package://two_link_description/meshes/upper.stl"/></geometry></collision>
  </link>
  <link name="lower_link">
    <inertial><origin xyz="0.1 0 0"/><mass value="0.3"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="joint_a" type="revolute"><parent link="base_link"/><child link="upper_link"/>
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="20" velocity="3"/>
    <dynamics damping="0.2" friction="0.1"/>
  </joint>
  <joint name="joint_b" type="revolute"><parent link="upper_link"/><child link="lower_link"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="10" velocity="3"/></joint>
</robot>
"""


def draft(path: Path, name: str, log: RawLog | None = None, root: Path | None = None, **stated) -> Drafted:
    """A draft made in this process, which is faster than in one of its own."""
    notes = Notes()
    return draft_robot(read_source(path, root, notes), name, DraftOptions(**stated), log, notes)


def quadruped(kp: float = 30.0) -> str:
    """A dog of 8 joints, none of which has a name, on a free joint that has none either."""
    named, lines = QUADRUPED, []
    for leg, _, _ in _LEGS:
        for part in ("thigh", "shank"):
            at = named.index("<joint axis")
            named = f'{named[:at]}<joint name="{leg}_{part}" axis{named[at + 11 :]}'
            lines.append(f'<position joint="{leg}_{part}" kp="{kp:g}" kv="0.6" forcerange="-6 6"/>')
    return named.replace("{actuators}", "\n    ".join(lines))


def in_folders(folder: Path) -> Path:
    """An arm whose parts lie in other folders: an include, a mesh in its own folder, one above the model's."""
    (folder / "model" / "parts").mkdir(parents=True)
    (folder / "shared").mkdir()
    corners = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (folder / "shared" / "tip.obj").write_text(corners)
    (folder / "model" / "parts" / "body.xml").write_text(
        '<mujoco><asset><mesh name="tip" file="tip.obj"/></asset><worldbody><body name="link">'
        '<joint name="turn" axis="0 1 0" damping="0.1"/><geom type="mesh" mesh="tip" mass="1"/></body>'
        "</worldbody></mujoco>"
    )
    scene = folder / "model" / "scene.xml"
    scene.write_text(
        '<mujoco><compiler meshdir="../shared"/><include file="parts/body.xml"/>'
        '<worldbody><geom name="table" type="plane" size="1 1 0.1" pos="0 0 -0.2"/></worldbody>'
        '<actuator><position joint="turn" kp="30" kv="2"/></actuator></mujoco>'
    )
    return scene
