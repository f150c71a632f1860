"""A free base that a log follows: drafted with its odometry, and replayed from wherever it was."""

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import strangers
from scipy.spatial.transform import Rotation

from dynreg.data.ingest import read_log, read_recording
from dynreg.data.maps import parse_map
from dynreg.draft.ground import standing_height
from dynreg.replay.data import data
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.layout import base_motion, layout_of, place_base
from dynreg.sim.robot import load_robot

RATE = 100.0


def walked(text: str, lifted: float = 0.0) -> pd.DataFrame:
    """Three seconds of a quadruped that sways, with its base's pose and speeds. lifted : added to the height."""
    model = mujoco.MjModel.from_xml_string(text)
    state, rows = mujoco.MjData(model), []
    joints = [j for j in range(model.njnt) if model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE]
    home = state.qpos[model.jnt_qposadr[joints]].copy()
    for step in range(round(3 * RATE)):
        told = home + 0.1 * np.sin(2 * np.pi * (0.5 + 0.1 * np.arange(len(joints))) * step / RATE)
        state.ctrl[:] = told
        x, y, z, *quat = state.qpos[:7]
        turned = Rotation.from_quat(quat, scalar_first=True)
        yaw, pitch, roll = turned.as_euler("ZYX")
        vx, vy, vz = turned.inv().apply(state.qvel[:3])
        wx, wy, wz = state.qvel[3:6]
        base = dict(
            x=x, y=y, z=z + lifted, roll=roll, pitch=pitch, yaw=yaw, vx=vx, vy=vy, vz=vz, wx=wx, wy=wy, wz=wz
        )
        row = {"t_s": step / RATE} | {f"base_{name}": value for name, value in base.items()}
        for j, command in zip(joints, told, strict=True):
            name = model.joint(j).name
            at, dof = model.jnt_qposadr[j], model.jnt_dofadr[j]
            row |= {f"pos_{name}": state.qpos[at], f"vel_{name}": state.qvel[dof], f"cmd_{name}": command}
        rows.append(row)
        mujoco.mj_step(model, state, round(1 / RATE / model.opt.timestep))
    return pd.DataFrame(rows)


def drafted(folder: Path, lifted: float = 0.0, turned: float = 0.0, without: tuple[str, ...] = ()):
    floor = '<worldbody>\n    <geom name="floor" type="plane" size="5 5 0.1"/>'
    text = strangers.quadruped().replace("<worldbody>", floor, 1)
    (folder / "dog.xml").write_text(text)
    log = walked(text, lifted).drop(columns=[f"base_{name}" for name in without])
    log["base_yaw"] += turned
    log.to_csv(folder / "run.csv", index=False)
    made = strangers.draft(folder / "dog.xml", "dog", log=read_log(folder / "run.csv"))
    for name, content in made.files.items():
        (folder / "dog" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "dog" / name).write_bytes(content)
    return made, load_robot(folder / "dog")


def test_replays_begin_where_the_base_was(tmp_path):
    """In windows of a second from anywhere in the log, the nominal robot moves as the one that was logged."""
    made, robot = drafted(tmp_path)
    assert robot.file.reset.base == "measured" and robot.file.replay.horizon == 1.0
    recording = read_recording(
        tmp_path / "run.csv", robot.recording_spec, parse_map(made.files[made.map].decode())
    )
    cut = data(robot, recording, "0")
    error = errors(Replayer(robot, cut.windows, 1).residuals(robot.space.nominal[None], cut.parts.chosen))
    assert len(cut.windows) >= 2 and error.max() < 0.1


def test_a_height_of_another_origin_is_left_out(tmp_path):
    made, robot = drafted(tmp_path, lifted=1.0)
    assert "z" not in {name.partition("/")[2] for name in robot.channels}
    assert any("/z is left out" in note for note in made.notes)
    recording = read_recording(
        tmp_path / "run.csv", robot.recording_spec, parse_map(made.files[made.map].decode())
    )
    cut = data(robot, recording, "0")
    error = errors(Replayer(robot, cut.windows, 1).residuals(robot.space.nominal[None], cut.parts.chosen))
    assert error.max() < 0.2  # its lowest foot touches the ground


def test_without_an_attitude_the_place_and_heading_of_a_log_do_not_matter_and_its_height_does_not_count(
    tmp_path,
):
    """A replay begins in the keyframe's pose, at the origin; its height alone hangs on where the origin is."""
    made, robot = drafted(tmp_path, lifted=1.0, turned=2.0, without=("roll", "pitch", "x"))
    weights = {c.name.partition("/")[2]: c.weight for c in robot.file.channels if c.name.startswith("base/")}
    assert robot.file.reset.base == "keyframe" and weights["z"] == 0.0 and weights["yaw"] > 0.0
    recording = read_recording(
        tmp_path / "run.csv", robot.recording_spec, parse_map(made.files[made.map].decode())
    )
    cut, yaw = data(robot, recording), robot.channels.index("base/yaw")
    states = Replayer(robot, cut.windows, 1).states(robot.space.nominal[None], np.arange(len(cut.windows)))
    assert np.abs(states[0, ..., yaw] - cut.windows.measured[..., yaw]).max() < 0.1


def test_placing_a_base_undoes_observing_it(tmp_path):
    _, robot = drafted(tmp_path)
    layout, model = layout_of(robot), robot.model
    rng = np.random.default_rng(3)
    qpos, qvel = rng.normal(size=(5, model.nq)), rng.normal(size=(5, model.nv))
    motion = base_motion(layout, qpos, qvel)
    states = np.full((5, len(robot.channels)), np.nan)
    states[:, layout.base[0]] = motion[:, layout.base[1]]
    again, speeds = np.zeros_like(qpos), np.zeros_like(qvel)
    lower = place_base(layout, states, again, speeds)
    assert base_motion(layout, again, speeds) == pytest.approx(motion, abs=1e-9) and not lower.any()
    states[0, layout.base[0]] = np.nan
    kept = again.copy()
    place_base(layout, states, again, speeds)
    assert (again[0] == kept[0]).all()


@pytest.mark.parametrize(
    "shape",
    [
        'type="capsule" size="0.05 0.2"',
        'type="cylinder" size="0.05 0.2"',
        'type="ellipsoid" size="0.05 0.1 0.2"',
    ],
)
def test_a_tilted_body_stands_where_it_touches_the_ground(shape: str):
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="5 5 0.1"/><body pos="0 0 1"><freejoint/>'
        f'<geom {shape} euler="50 20 0"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[2] = standing_height(model, 0, model.qpos0) - 0.001
    mujoco.mj_forward(model, data)
    assert data.ncon and data.contact.dist.min() == pytest.approx(-0.001, abs=1e-4)
