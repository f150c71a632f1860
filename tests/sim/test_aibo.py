"""The AIBO of the paper on staged calibration: it stands, walks on commands, and each of its numbers acts."""

import mujoco
import numpy as np
import pytest

from dynreg.sim.effects import placed, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import reset_pose
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

RATE = 125
CONTACT = {
    "mu": "mj.geom_friction",
    "spin_friction": "mj.geom_friction",
    "impedance_ratio": "mj.opt.impratio",
    "rolling_friction": "mj.geom_friction",
    "bounce": "mj.geom_solref",
    "first_impedance": "mj.geom_solimp",
    "contact_time": "mj.geom_solref",
    "full_impedance": "mj.geom_solimp",
}


@pytest.fixture(scope="module")
def aibo() -> Robot:
    return load_robot("aibo")


def trot(robot: Robot, seconds: float) -> Run:
    """A trot of 1.5 Hz about the stance: of diagonal legs one pair swings while the other stands."""
    t = np.arange(round(seconds * RATE)) / RATE
    targets, ramp = np.tile(reset_pose(robot), (len(t), 1)), np.minimum(2 * t, 1.0)
    for i, leg in enumerate(("fl", "fr", "rl", "rr")):
        phase = 2 * np.pi * 1.5 * t + (0.0 if leg in ("fl", "rr") else np.pi)
        ahead = 1.0 if leg[0] == "f" else -1.0  # a rear leg is a front one, mirrored
        targets[:, 3 * i] += ahead * 0.2 * ramp * np.sin(phase)
        targets[:, 3 * i + 2] += 0.25 * ramp * np.maximum(np.cos(phase), 0.0)
    return Run(targets[None])


def column(robot: Robot, name: str) -> int:
    return list(robot.channels).index(name)


def posed(robot: Robot, **angles: float) -> mujoco.MjData:
    data = mujoco.MjData(robot.model)
    for name, angle in angles.items():
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(robot.model, data)
    return data


def test_its_masses_and_lengths_are_the_paper_s(aibo: Robot):
    assert aibo.model.body_mass.sum() == pytest.approx(0.613 + 0.025 + 0.19 + 4 * (0.05 + 2 * 0.073))
    data = posed(aibo)
    for leg, ahead, side, length, turned in (
        ("fl", 1, 1, 0.06543, -4.4),
        ("fr", 1, -1, 0.06543, -4.4),
        ("rl", -1, 1, 0.06765, -11.5),
        ("rr", -1, -1, 0.06765, -11.5),
    ):
        hip = data.body("torso").xpos + [0.065 * ahead, 0.0625 * side, 0.0]
        elbow, paw = data.geom(f"{leg}_elbow").xpos, data.geom(f"{leg}_paw").xpos
        np.testing.assert_allclose(elbow - hip, [0.0, 0.009 * side, -0.0695], atol=1e-5)
        along = np.deg2rad(turned) * ahead
        np.testing.assert_allclose(
            paw - elbow, [length * np.sin(along), 0.0, -length * np.cos(along)], atol=1e-5
        )


def test_a_joint_turns_all_legs_alike_and_the_rear_ones_mirrored(aibo: Robot):
    """Rotors turn front legs forward and rear ones backward, elevators all outward, knees paws as rotors do."""
    plain = posed(aibo)
    for leg, ahead, side in (("fl", 1, 1), ("fr", 1, -1), ("rl", -1, 1), ("rr", -1, -1)):
        moved = {
            joint: posed(aibo, **{f"{leg}_{joint}": 0.3}).geom(f"{leg}_paw").xpos
            - plain.geom(f"{leg}_paw").xpos
            for joint in ("rotor", "elevator", "knee")
        }
        assert moved["rotor"][0] * ahead > 0.02 and moved["knee"][0] * ahead > 0.01
        assert moved["elevator"][1] * side > 0.02


def test_it_stands_in_its_reset_pose(aibo: Robot):
    pose = reset_pose(aibo)
    found = rollout(aibo, aibo.space.nominal[None], Run(np.tile(pose, (1, 2 * RATE, 1))), threads=1)
    last = found.states[0, 0, -1]
    assert found.fell[0, 0] > 2 * RATE
    np.testing.assert_allclose(last[:12], pose, atol=2e-3)
    assert np.abs(last[[column(aibo, f"base/{c}") for c in ("roll", "pitch")]]).max() < 0.05


def test_it_has_the_paper_s_38_parameters(aibo: Robot):
    motors = [p for p in aibo.space.parameters if p.sets[0].startswith("port.drive.")]
    assert len(aibo.space) == 38 and len(motors) == 30
    for place in ("front", "rear"):
        for joint in ("rotor", "elevator", "knee"):
            names = {p.name for p in motors if p.name.startswith(f"{place}_{joint}_")}
            assert names == {f"{place}_{joint}_{key}" for key in ("speed", "torque", "p", "i", "d")}
    assert {p.name: p.sets[0].split("[")[0].removesuffix(" =") for p in aibo.space.parameters[30:]} == CONTACT


def test_every_number_of_contact_and_solver_changes_a_walk(aibo: Robot):
    """A short trot at each end of a range; a millionth more of one joint's speed shows the walk's own unrest."""
    space, run = aibo.space, trot(aibo, 0.8)
    rows = [space.nominal, space.nominal.copy()]
    rows[1][0] *= 1 + 1e-6
    for i, p in enumerate(space.parameters[30:], start=30):
        for end in (p.low, p.high):
            rows.append(space.nominal.copy())
            rows[-1][i] = end
    states = rollout(aibo, np.array(rows), run, threads=1).states[:, 0]
    seen = [column(aibo, f"base/{c}") for c in ("vx", "vy", "wz")]
    changes = np.sqrt(((states - states[0])[..., seen] ** 2).mean(axis=1)).max(axis=1)
    by_parameter = dict(zip(CONTACT, changes[2:].reshape(-1, 2).max(axis=1), strict=True))
    assert min(by_parameter.values()) > max(0.02, 100 * changes[1]), by_parameter


def test_it_walks_ahead_on_a_hand_made_trot(aibo: Robot):
    run = trot(aibo, 2.5)
    found = rollout(aibo, aibo.space.nominal[None], run, threads=1)
    assert found.fell[0, 0] > run.steps
    assert found.states[0, 0, RATE:, column(aibo, "base/vx")].mean() > 0.08


def test_its_elbows_are_a_second_material_that_reaches_the_ground(aibo: Robot):
    keys = [t.key for t in placed(aibo, term("second_friction_material").effect)]
    assert keys == ["second_friction_material"] + [f"second_friction_material[{m}]" for m in ("paw", "elbow")]
    low = posed(
        aibo, **{f"{leg}_{j}": q for leg in ("fl", "fr") for j, q in (("rotor", -0.3), ("knee", 2.1))}
    )
    low.qpos[2] -= low.geom("fl_elbow").xpos[2] - 0.0105  # forearms lie flat, as in robot football
    mujoco.mj_forward(aibo.model, low)
    touching = {aibo.model.geom(int(max(c.geom))).name for c in low.contact}
    assert {"fl_elbow", "fr_elbow"} <= touching and not {"fl_paw", "fr_paw"} & touching
