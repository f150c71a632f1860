"""Writes `my_arm.xml` and `my_arm.csv`: an arm with one joint, and a log of it, to try dynreg on.

MuJoCo alone makes the log. There a cable pulls at the joint with 0.8 N*m, which the model does not have.

    python examples/my_arm.py
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

MODEL = """<mujoco model="my_arm">
  <compiler angle="radian"/>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="link" pos="0 0 0.5">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.1" armature="0.01" range="-2.5 2.5"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1.0" contype="0"/>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="40" kv="2" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""
PULL = 0.8  # N*m, of the cable
SECONDS, RATE, NOISE = 12.0, 50.0, 0.0005  # s, Hz, rad


def main() -> None:
    """Write both files into the working folder."""
    Path("my_arm.xml").write_text(MODEL, encoding="utf-8")
    with open("my_arm.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["time", "cmd_shoulder", "pos_shoulder"])
        table.writerows([f"{value:.4f}" for value in row] for row in log())


def log() -> Iterator[tuple[float, float, float]]:
    """Time [s], command and noisy position [rad], 50 times a second."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    model.opt.timestep = 0.001  # [s] a fifth of the model's: the robot is no simulation
    data, random = mujoco.MjData(model), np.random.default_rng(7)
    data.qfrc_applied[0] = PULL
    for step in range(round(SECONDS * RATE)):
        time = step / RATE
        data.ctrl[0] = 0.8 * np.sin(2.0 * time) if time % 6.0 < 3.0 else (0.6, -0.8, 0.1)[int(time) % 3]
        yield time, data.ctrl[0], data.qpos[0] + NOISE * random.standard_normal()
        mujoco.mj_step(model, data, round(1.0 / RATE / model.opt.timestep))


if __name__ == "__main__":
    main()
