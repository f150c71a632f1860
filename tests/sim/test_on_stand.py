"""A robot on a stand: its base is held, nothing touches it, and all else is as it was."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import toy_dog

from dynreg.errors import UsageError
from dynreg.folder import Folder
from dynreg.sim.effects import applicable
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import reset_pose
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.stand import legs_of, on_stand
from dynreg.verbs.robots import robot_check


@pytest.fixture(scope="module")
def quadruped() -> Robot:
    return load_robot("quadruped")


@pytest.fixture(scope="module")
def stand(quadruped: Robot) -> Robot:
    return on_stand(quadruped)


def test_only_the_base_is_gone(quadruped: Robot, stand: Robot) -> None:
    assert quadruped.floating and not stand.floating
    assert stand.name == "quadruped_on_stand" and stand.hash != quadruped.hash
    assert stand.channels == tuple(c for c in quadruped.channels if not c.startswith("base/"))
    assert stand.actions == quadruped.actions
    assert {*quadruped.space.names} - {*stand.space.names} == {"friction", "torso_mass"}
    assert stand.file.robot.timestep == 0.001 < quadruped.file.robot.timestep
    assert stand.model.nq == quadruped.model.nq - 7 == len(stand.actions)
    assert (reset_pose(stand) == reset_pose(quadruped)).all()
    assert stand.file.fall is None and not stand.file.tasks and stand.file.gait is None
    assert stand.model.body_subtreemass[1] == pytest.approx(quadruped.model.body_subtreemass[1])


def test_its_legs_touch_nothing_whatever_they_do(stand: Robot) -> None:
    assert not {"ground_friction", "contact_compliance"} & {*applicable(stand)}
    model = stand.model
    data = mujoco.MjData(model)  # its legs stretched down
    mujoco.mj_forward(model, data)
    feet = [g for g in range(model.ngeom) if model.geom(g).name.endswith("_foot")]
    assert data.geom_xpos[feet, 2].min() > 0.3 and data.ncon == 0


def test_a_leg_that_hangs_does_not_move_the_others(stand: Robot) -> None:
    actions = np.tile(reset_pose(stand), (1, 36, 1))
    still = rollout(stand, stand.space.nominal[None], Run(actions)).states[0, 0]
    moved = actions.copy()
    moved[:, 5:, :3] += 0.3
    states = rollout(stand, stand.space.nominal[None], Run(moved)).states[0, 0]
    own = [c.startswith("fl_") for c in stand.channels]
    assert np.abs(states - still)[:, own].max() > 0.2
    assert np.abs(states - still)[:, np.logical_not(own)].max() < 1e-9


def test_its_folder_is_sound(stand: Robot, tmp_path: Path) -> None:
    for name, data in stand.files.files.items():
        (tmp_path / name).write_bytes(data)
    assert robot_check(str(tmp_path)).sound and load_robot(tmp_path).hash == stand.hash


def test_changed_parameters_stay(quadruped: Robot) -> None:
    space = quadruped.space
    heavy = replace(space.parameters[0], nominal=40.0)
    changed = replace(quadruped, space=replace(space, parameters=(heavy, *space.parameters[1:])))
    assert on_stand(changed).space.parameters[0].nominal == 40.0


@pytest.mark.parametrize("written", ["", ' euler="0 90 0"', ' axisangle="0 1 0 90"'])
def test_the_base_keeps_the_attitude_of_the_keyframe(written: str, quadruped: Robot, tmp_path: Path) -> None:
    """However the model writes where the base is."""
    for name, data in quadruped.files.files.items():
        text = data.decode()
        if name == "model.xml":
            text = text.replace('<body name="torso"', f'<body name="torso"{written}')
            text = re.sub(r'(<key name="\w+" qpos="\S+ \S+ \S+) 1 0 0 0', r"\1 0.8 0 0.6 0", text)
        (tmp_path / name).write_text(text)
    robot = load_robot(tmp_path)
    attitude = robot.model.key_qpos[robot.keyframe, 3:7]
    assert attitude == pytest.approx([0.8, 0.0, 0.6, 0.0])
    assert on_stand(robot).model.body("torso").quat == pytest.approx(attitude, abs=1e-5)


def test_a_robot_whose_base_is_held_is_itself() -> None:
    servo = load_robot("servo_pendulum")
    assert on_stand(servo) is servo


def test_a_ball_beside_it_is_held_too_and_not_tracked(tmp_path: Path) -> None:
    walking, gain, mass = (
        toy_dog.walking(),
        *(
            f'[[parameters]]\nname = "{name}"\nunit = "{unit}"\nnominal = {nominal}\nlow = {nominal / 2}\n'
            f'high = {2 * nominal}\nsets = ["{sets} ="]\n'
            for name, unit, nominal, sets in (
                ("gain", "1", 15.0, "port.drive.gain[*]"),
                ("ball", "kg", 0.02, "mj.body_mass[ball]"),
            )
        ),
    )
    plain = on_stand(load_robot(toy_dog.folder(tmp_path / "plain", walking, gain)))
    folder = toy_dog.folder(tmp_path / "dog", walking, gain + mass, ball=True)
    path = folder / "robot.toml"
    path.write_text(path.read_text().replace('["ball"]', '[\n  "ball",  # to kick\n]  # one'))
    stand = on_stand(load_robot(folder))
    assert not stand.floating and stand.file.robot.tracked == [] and stand.model.nq == 12
    assert (reset_pose(stand) == reset_pose(plain)).all() and stand.space.names == plain.space.names
    run = Run(np.tile(reset_pose(stand) + 0.2, (1, 20, 1)))
    values = plain.space.nominal[None]
    assert np.array_equal(*(rollout(one, values, run).states for one in (plain, stand)))


def test_other_words_for_the_base_are_left_out(quadruped: Robot) -> None:
    text = quadruped.files.files["robot.toml"].replace(b"settle = 0.3", b'settle = 0.3\nbase = "measured"')
    files = Folder({**quadruped.files.files, "robot.toml": text})
    made = on_stand(replace(quadruped, files=files))
    assert made.file.reset.base == "keyframe" and made.file.reset.settle == 0.3


def test_legs_are_what_hangs_from_the_base(quadruped: Robot, stand: Robot) -> None:
    legs = legs_of(quadruped)
    assert legs == legs_of(stand) and list(legs) == ["fl", "fr", "rl", "rr"]
    assert legs["rl"] == ("rl_hip", "rl_shoulder", "rl_elbow")
    assert legs_of(load_robot("leg")) == {"hip_roll": ("hip_roll", "hip_pitch", "knee")}
    with pytest.raises(UsageError, match="has no legs"):
        legs_of(load_robot("husky"))
