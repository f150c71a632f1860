"""A lag and a limited rate of the commands have their true sizes where windows of a log begin in transients."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.sim.robot import load_robot

SIZES = {"command_lag": ("time", 0.05), "rate_limit": ("rate", 4.0)}  # s, rad/s
PERIOD, FINE = 0.02, 0.0002  # s between commands; the time step of the hidden robot
MODEL = """<mujoco>
  <option timestep="0.004" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="arm" axis="0 1 0" armature="0.02" damping="0.1"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.8" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><position name="arm" joint="arm" kp="40" kv="2" forcerange="-20 20"/></actuator>
</mujoco>"""
TOML = """
[robot]
name = "lagging_arm"
engines = ["{engine}"]
control_rate = 50.0
timestep = 0.004

[[drives]]
joint = "arm"
type = "position"
gain = 40.0
rate_gain = 2.0
torque_limit = 20.0

[replay]
horizon = 0.5

[[actions]]
name = "arm/target"
unit = "rad"

[[channels]]
name = "arm/position"
unit = "rad"
noise = 0.002

[[channels]]
name = "arm/velocity"
unit = "rad/s"
noise = 0.05

[[parameters]]
name = "gain"
unit = "1"
nominal = 1.0
low = 0.4
high = 2.5
scale = "log"
tolerance = 0.1
sets = ["port.drive.gain_factor *="]

[[parameters]]
name = "armature"
unit = "kg*m^2"
nominal = 0.02
low = 0.005
high = 0.1
scale = "log"
tolerance = 0.3
sets = ["mj.dof_armature[arm] ="]
"""


def log(effect: str) -> Recording:
    """Steps every 0.34 s behind an effect, by MuJoCo and a filter of this test's own: no code of dynreg."""
    rng, rows = np.random.default_rng(4), 1000
    told = rng.uniform(-0.9, 0.9, rows // 17 + 1).repeat(17)[:rows]
    told[:17] = 0.0  # at rest where it is
    model = mujoco.MjModel.from_xml_string(MODEL)
    model.opt.timestep = FINE
    data, held, values = mujoco.MjData(model), told[0], np.empty((rows, 3))
    lags, size = effect == "command_lag", SIZES[effect][1]
    keep, reach = np.exp(-FINE / size), size * FINE
    for row, target in enumerate(told):
        noise = rng.standard_normal(2) * [0.002, 0.05]
        values[row] = data.qpos[0] + noise[0], data.qvel[0] + noise[1], target
        for _ in range(round(PERIOD / FINE)):
            data.ctrl[0] = held  # late by half a time step, as MuJoCo moves the joint early by as much
            held = target + (held - target) * keep if lags else held + np.clip(target - held, -reach, reach)
            mujoco.mj_step(model, data)
    names = (Channel("arm/position", "rad"), Channel("arm/velocity", "rad/s"), Channel("arm/target", "rad"))
    return Recording(names, (Episode("steps", np.arange(rows) * PERIOD, values),), measured=False)


@pytest.mark.parametrize(
    "effect, engine", [("command_lag", "joint"), ("command_lag", "mujoco"), ("rate_limit", "joint")]
)
def test_what_smooths_steps_is_found_as_large_as_it_is(effect: str, engine: str, tmp_path: Path) -> None:
    folder = tmp_path / "lagging_arm"
    folder.mkdir()
    (folder / "model.xml").write_text(MODEL, encoding="utf-8")
    (folder / "robot.toml").write_text(TOML.format(engine=engine), encoding="utf-8")
    with dynreg.open(tmp_path / "registry") as registry:
        name = registry.ingest(log(effect), load_robot(folder), name="steps").recording
        found = registry.diagnose(name, effects=(effect,), threshold_runs=0, threads=1)
    (cause,) = found.causes
    name, size = SIZES[effect]
    fitted = cause.parameters[name]
    assert (found.verdict, cause.effect) == ("named", effect)
    assert fitted.value == pytest.approx(size, rel=0.1)
    assert fitted.low <= size <= fitted.high
