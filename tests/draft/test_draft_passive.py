"""A joint that nothing drives has damping and dry friction to find, and it is said that no effect acts there."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import strangers

import dynreg
from dynreg.diagnose.joints import only_joints, passive_joints
from dynreg.diagnose.where import ErrorRow
from dynreg.draft.entry import Drafted, write_draft
from dynreg.errors import UsageError
from dynreg.sim.engines import rollout
from dynreg.sim.run import Run
from dynreg.verbs.diagnosis_words import not_driven

PLANTED = 0.02  # N*m*s/rad
RATE, STEPS = 50.0, 250


def drafted(folder: Path, text: str = strangers.CARTPOLE) -> Drafted:
    (folder / "robot.xml").write_text(text)
    return strangers.draft(folder / "robot.xml", "stranger")


@pytest.fixture(scope="module")
def cartpole(tmp_path_factory) -> Drafted:
    return drafted(tmp_path_factory.mktemp("cartpole"))


def log_of(made: Drafted, damping: float) -> str:
    """A log of the robot whose hinge has this damping, as a lab would write it."""
    robot = made.robot
    values = robot.space.nominal.copy()
    values[robot.space.names.index("hinge_damping")] = damping
    time = np.arange(STEPS + 1) / RATE
    push = 0.3 * np.sin(2 * np.pi * 0.8 * time) + 0.2 * np.sin(2 * np.pi * 1.7 * time + 1.0)
    run = Run(push[None, :-1, None])
    states = rollout(robot, values[None], run, engine="mujoco", threads=1).states[0, 0]
    columns = np.stack([time, push, *states.T], axis=1)
    rows = [",".join(f"{v:.6f}" for v in row) for row in columns]
    return "\n".join([",".join(("time", *robot.actions, *robot.channels)), *rows])


def test_the_damping_of_a_hinge_without_a_drive_is_found(cartpole: Drafted, tmp_path: Path):
    folder = tmp_path / "cart"
    write_draft(cartpole, folder)
    (tmp_path / "run.csv").write_text(log_of(cartpole, PLANTED))
    with dynreg.open(tmp_path / "registry") as session:
        session.ingest(tmp_path / "run.csv", robot=folder, name="run")
        found = session.calibrate("run", method="cma", budget=150, threads=1)
    assert abs(found.parameters["hinge_damping"].value - PLANTED) < 0.2 * PLANTED


def test_joints_that_something_else_moves_have_no_such_parameter(cartpole: Drafted, tmp_path: Path):
    assert {"hinge_damping", "hinge_friction"} <= {*cartpole.robot.space.names}
    follows = '<equality><joint joint1="hinge" joint2="slider"/></equality></mujoco>'
    for name, text in {
        "driven": strangers.ARM.format(actuators=""),
        "follows": strangers.CARTPOLE.replace("</mujoco>", follows),
    }.items():
        (tmp_path / name).mkdir()
        made = drafted(tmp_path / name, text)
        assert not any("no drive moves" in note for note in made.notes)
        assert "hinge_damping" not in made.robot.space.names
        assert passive_joints(made.robot) == ()


def test_a_joint_without_a_drive_is_refused_as_such(cartpole: Drafted):
    with pytest.raises(UsageError, match=r"'hinge' .*is not driven.*mj.dof_damping\[hinge\]"):
        only_joints(cartpole.robot, ("hinge",))


@pytest.mark.parametrize("share, said", [(0.7, ["hinge is not driven: 70 %"]), (0.1, [])])
def test_an_error_at_a_joint_without_a_drive_is_told(cartpole: Drafted, share: float, said: Sequence[str]):
    rows = [
        ErrorRow("hinge/position", "rad", None, "overall", 0.1, share, None, 100),
        ErrorRow("slider/position", "m", "slider", "overall", 0.1, 1.0 - share, None, 100),
    ]
    lines = [*not_driven(cartpole.robot, rows)]
    assert len(lines) == len(said) and all(one in line for one, line in zip(said, lines, strict=True))
    assert all("hinge_friction, hinge_damping are fitted there" in line for line in lines)
