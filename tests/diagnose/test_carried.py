"""A mass that an arm carries is found where it is: the log is MuJoCo's own of an arm with a body welded there."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import dynreg
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot

JOINTS, GAINS = ("shoulder", "elbow", "wrist"), (200.0, 120.0, 60.0)
RATE, STEP, NOISE, EPISODES = 50.0, 0.002, 2e-4, 6
FRICTION, DAMPING = 0.4, 0.5  # N m, N m s/rad
CARRIED = 0.6  # kg


def model_text(carried: float = 0.0, timestep: float = STEP) -> str:
    links = ""
    for name, mass in zip(JOINTS, (3.0, 1.5, 0.6), strict=True):
        links += (
            f'<body name="{name}_link" pos="0 0 0.3"><joint name="{name}" axis="0 1 0" damping="{DAMPING}" '
        )
        links += f'frictionloss="{FRICTION}" armature="0.05"/>'
        links += f'<inertial mass="{mass}" pos="0 0 0.15" diaginertia="0.01 0.01 0.002"/>'
    load = f'<body pos="0 0 0.3"><geom size="0.005" mass="{carried}"/></body>' if carried else ""
    motors = "".join(
        f'<position name="{n}" joint="{n}" kp="{g}" kv="{g / 20}"/>'
        for n, g in zip(JOINTS, GAINS, strict=True)
    )
    return (
        f'<mujoco><option timestep="{timestep}"/><worldbody>{links}<site name="flange" pos="0 0 0.3"/>{load}'
        f"{'</body>' * 3}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def made(folder: Path) -> Robot:
    """The arm without what it carries; its gains and dry frictions are not told by the nameplate."""
    (folder / "model.xml").write_text(model_text(), encoding="utf-8")
    toml = f'[robot]\nname = "arm"\nengines = ["mujoco"]\ncontrol_rate = {RATE}\ntimestep = {STEP}\n'
    toml += 'tools = ["flange"]\n[replay]\nhorizon = 1.0\n'
    for name, unit, value, sets in (
        ("friction", "N*m", 1.5 * FRICTION, "mj.dof_frictionloss[*] ="),
        ("gain", "1", 1.1, "port.drive.gain[*] *="),
    ):
        toml += f'[[parameters]]\nname = "{name}"\nunit = "{unit}"\nnominal = {value}\nlow = {value / 3}\n'
        toml += f'high = {value * 3}\nscale = "log"\nsets = ["{sets}"]\n'
    for name, gain in zip(JOINTS, GAINS, strict=True):
        toml += f'[[drives]]\njoint = "{name}"\ntype = "position"\ngain = {gain}\nrate_gain = {gain / 20}\n'
        toml += f'[[actions]]\nname = "{name}/target"\nunit = "rad"\n'
        toml += f'[[channels]]\nname = "{name}/position"\nunit = "rad"\nnoise = {NOISE}\n'
    (folder / "robot.toml").write_text(toml, encoding="utf-8")
    return load_robot(folder)


def logged(carried: float) -> Recording:
    """From rest, all joints moving, by time steps half as long as the model's."""
    model = mujoco.MjModel.from_xml_string(model_text(carried, STEP / 2))
    rng, episodes = stream(7, "carried"), []
    for number in range(EPISODES):
        data, time = mujoco.MjData(model), np.arange(round(2 * RATE)) / RATE
        rate, size = rng.uniform(0.3, 1.0, 3), rng.uniform(0.3, 0.6, 3)
        told = size * np.sin(2 * np.pi * rate * time[:, None])
        mujoco.mj_step(model, data, nstep=2000)  # it sags
        rows = []
        for target in told:
            data.ctrl[:] = target
            rows.append([*data.qpos + NOISE * rng.standard_normal(3), *target])
            mujoco.mj_step(model, data, nstep=round(2 / (RATE * STEP)))
        episodes.append(Episode(f"run_{number}", time, np.array(rows), {}))
    channels = [Channel(f"{j}/{kind}", "rad") for kind in ("position", "target") for j in JOINTS]
    return Recording(tuple(channels), tuple(episodes), measured=False)


def test_what_it_carries_is_named_at_the_flange_in_kilograms(tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    robot = made(tmp_path / "arm")
    with dynreg.open(tmp_path / "registry") as session:
        name = session.ingest(logged(CARRIED), robot, name="log").recording
        found = session.diagnose(
            name, hold_out="run_5", effects=["payload"], windows=4, max_causes=1, threshold_runs=0, threads=1
        )
    first = found.causes[0]
    assert (first.key, first.joints, first.bodies) == ("payload[flange]", (), ("flange",))
    assert (
        first.parameters["mass"].value == pytest.approx(CARRIED, rel=0.1)
        and first.parameters["mass"].unit == "kg"
    )
    assert {one.key for one in found.ranking} == {"payload", "payload[wrist_link]", "payload[flange]"}
    assert "flange" in found.sentence
