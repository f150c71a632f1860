"""Contacts that a draft takes out: where links hardly ever meet, and meet nothing else."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import strangers

from dynreg.draft.entry import Drafted

FLOOR = '<geom name="floor" type="plane" size="2 2 0.1" pos="0 0 {height}"/>'
BOX = """<body name="box" pos="0.3 0.3 0.4"><joint name="lift" type="slide" axis="0 0 1" range="-0.36 0.3"/>
  <geom name="box" type="box" size="0.05 0.05 0.05" mass="0.1"/></body>"""


def drafted(folder: Path, beside: str = "", text: str = strangers.ARM) -> Drafted:
    path = folder / "arm.xml"
    text = text.format(actuators=strangers.POSITION)
    path.write_text(text.replace("<worldbody>", f"<worldbody>{beside}"))
    return strangers.draft(path, "arm")


def test_links_that_do_not_meet_pass_through_each_other(tmp_path):
    made = drafted(tmp_path)
    assert not (made.robot.model.geom_contype | made.robot.model.geom_conaffinity).any()
    assert any("contacts between links are off" in note for note in made.notes)


@pytest.mark.parametrize("height, kept", [(0.13, True), (-0.5, False)])
def test_an_arm_meets_a_floor_within_its_reach_alone(height, kept, tmp_path):
    """At its stops, if not in the middle of its range."""
    made = drafted(tmp_path, FLOOR.format(height=height))
    data = mujoco.MjData(made.robot.model)
    data.qpos[:] = np.pi / 2, 0.0
    mujoco.mj_forward(made.robot.model, data)
    assert (data.ncon > 0) is kept
    assert any("contacts between links are off" in note for note in made.notes) is not kept


def test_what_no_drive_moves_keeps_its_contacts(tmp_path):
    made = drafted(tmp_path, FLOOR.format(height=0.0) + BOX)
    model, data = made.robot.model, mujoco.MjData(made.robot.model)
    mujoco.mj_step(model, data, 1000)
    assert data.body("box").xpos[2] == pytest.approx(0.05, abs=0.01)
    assert not any("contacts between links are off" in note for note in made.notes)


def test_of_one_link_nothing_is_said(tmp_path):
    (tmp_path / "slider.xml").write_text(strangers.SLIDER)
    made = strangers.draft(tmp_path / "slider.xml", "slider")
    assert not any("contacts between links are off" in note for note in made.notes)
