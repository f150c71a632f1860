"""The small arm that the tests of the simulators use."""

ARM_XML = """
<mujoco model="arm">
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 -9.81"/>
  <default><geom contype="0" conaffinity="0" mass="0"/></default>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 0.1"/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" armature="0.01" damping="0.02" range="-120 120" limited="true"/>
      <inertial pos="0.1 0 -0.01" mass="0.4" diaginertia="0.001 0.003 0.003"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"/>
      <body name="lower" pos="0.2 0 0">
        <joint name="elbow" axis="0 1 0" armature="0.005"/>
        <inertial pos="0.08 0 0" mass="0.25" diaginertia="0.0005 0.001 0.001"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0.16 0 0" size="0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator>
  <keyframe><key name="home" qpos="0.3 -0.4"/></keyframe>
</mujoco>
"""

ARM_TOML = """
[robot]
name = "arm"
engines = ["mujoco"]
control_rate = 50.0
timestep = 0.002

[[drives]]
joint = "shoulder"
type = "position"
gain = 20.0
rate_gain = 0.3
torque_limit = 4.0
speed_limit = 8.0
back_emf = true

[[drives]]
joint = "elbow"
type = "torque"
gain = 0.5
torque_limit = 1.5

[reset]
keyframe = "home"

[excitation]
episodes = 8
steps = 20
kinds = ["levels", "walk"]
amplitude = 0.6

[[actions]]
name = "shoulder/target"
unit = "rad"
low = -2.0
high = 2.0

[[actions]]
name = "elbow/torque"
unit = "N*m"
low = -3.0
high = 3.0

[[channels]]
name = "shoulder/position"
unit = "rad"

[[channels]]
name = "elbow/position"
unit = "rad"

[[channels]]
name = "shoulder/velocity"
unit = "rad/s"

[[channels]]
name = "elbow/velocity"
unit = "rad/s"

[[settings]]
name = "added_mass"
unit = "kg"
nominal = 0.0
values = [0.0, 0.2, 0.4]
sets = ["mj.body_mass[lower] +="]

[[parameters]]
name = "gain"
unit = "N*m/rad"
nominal = 20.0
low = 5.0
high = 40.0
scale = "log"
sets = ["port.drive.gain[shoulder] ="]
"""


def parameter(name: str, *sets: str, nominal: float = 1.0, low: float = 0.5, high: float = 2.0) -> str:
    """A [[parameters]] table."""
    entries = ", ".join(f'"{entry}"' for entry in sets)
    return (
        f'[[parameters]]\nname = "{name}"\nunit = "1"\nnominal = {nominal}\nlow = {low}\nhigh = {high}\n'
        f"sets = [{entries}]\n"
    )
