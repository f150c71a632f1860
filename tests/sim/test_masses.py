"""Masses that are fixed to bodies: MuJoCo's own compiler must make the same of a body welded there."""

import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from dynreg.errors import RobotError
from dynreg.sim.engines import rollout
from dynreg.sim.masses import grow, moving_sites, weight_at
from dynreg.sim.robot import Robot, load_robot, packaged_robots
from dynreg.sim.run import Run

TURNED = 'pos="0.1 0.05 -0.03" euler="30 20 10"'
MODEL = """<mujoco><worldbody><site name="floor"/><body name="a"><joint name="j" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
<body name="b" pos="0.3 0 0"><joint name="k" axis="0 1 0.3"/>
<inertial pos="0.02 .01 0" quat="0.9 0.1 0.3 0.2" mass=".5" diaginertia=".002 .0015 .003"/>{}
</body></body></worldbody></mujoco>"""


def forces(model: mujoco.MjModel, change=lambda batch: None) -> np.ndarray:
    """Entries of the inertia matrix and bias forces, of a second simulator that was changed."""
    batch = Batch(model, 2)
    change(batch)
    batch.set_const()
    matrix, bias = batch.bind("M"), batch.bind("qfrc_bias")
    batch.bind("qpos")[:], batch.bind("qvel")[:] = [0.3, 0.4], [1.0, 2.0]
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
    return np.concatenate([matrix, bias], axis=1)


@pytest.mark.parametrize(
    "kind, size",
    [
        ("sphere", "0.05"),
        ("box", ".05 .03 .02"),
        ("cylinder", ".05 .03"),
        ("capsule", ".05 .03"),
        ("ellipsoid", ".05 .03 .02"),
    ],
)
def test_a_weight_has_the_shape_of_its_site(kind: str, size: str) -> None:
    marked = MODEL.format(f'<site name="t" type="{kind}" size="{size}" {TURNED}/>')
    welded = MODEL.format(f'<body {TURNED}><geom type="{kind}" size="{size}" mass="0.8"/></body>')
    model = mujoco.MjModel.from_xml_string(marked)
    made = forces(model, lambda b: weight_at(model, "t").add(b.expand, slice(1, 2), np.array([0.8])))
    np.testing.assert_allclose(made[1], forces(mujoco.MjModel.from_xml_string(welded))[0], rtol=1e-12)
    np.testing.assert_array_equal(made[0], forces(model)[0])


def test_what_carries_nothing_is_the_plain_model_to_the_bit() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format('<site name="t"/>'))
    made = forces(model, lambda b: weight_at(model, "t").add(b.expand, slice(None), np.zeros(2)))
    np.testing.assert_array_equal(made, forces(model))


def test_a_weight_is_taken_off_again_and_no_more_than_there_is() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(f'<site name="t" {TURNED}/>'))

    def there_and_back(batch: Batch) -> None:
        for mass in (0.8, -0.8):
            weight_at(model, "t").add(batch.expand, slice(None), np.full(2, mass))

    np.testing.assert_allclose(forces(model, there_and_back), forces(model), rtol=1e-12)
    with pytest.raises(RobotError, match="-0.1 kg"):
        weight_at(model, "t").add(Batch(model, 1).expand, slice(None), np.array([-0.6]))
    with pytest.raises(RobotError, match=r"kg\*m\^2 would be left"):
        weight_at(model, "t").add(Batch(model, 1).expand, slice(None), np.array([-0.45]))


def test_a_body_grows_about_its_own_centre() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(""))
    made = forces(model, lambda b: grow(b.expand, model, slice(1, 2), 2, np.array([[0.5]])))
    double = MODEL.format("").replace(
        'mass=".5" diaginertia=".002 .0015 .003"', 'mass="1" diaginertia=".004 .003 .006"'
    )
    np.testing.assert_allclose(made[1], forces(mujoco.MjModel.from_xml_string(double))[0], rtol=1e-12)


def test_only_sites_that_move_can_carry() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format('<site name="t"/>'))
    assert moving_sites(model) == ["t"]
    for name in ("floor", "nowhere"):
        with pytest.raises(RobotError, match=f"no site {name!r} on a body that moves; expected one of 't'"):
            weight_at(model, name)


DISC = """
[[settings]]
name = "disc"
unit = "kg"
nominal = 0.0
values = [0.0, 0.4]
sets = ["modifier.added_mass[disc] +="]
"""
RADIUS, THICK, HANGS = 0.06, 0.02, 0.08  # m


@pytest.mark.parametrize("engine", ["joint", "mujoco"])
def test_a_disc_that_a_setting_hangs_on_turns_with_its_own_inertia(engine: str, tmp_path: Path) -> None:
    """Of each episode its own mass; against the same disc welded on, and against a mass without inertia of its own."""
    shape = f'size="{RADIUS} {THICK / 2}" pos="0 0 {-HANGS}" euler="90 0 0"'
    marked = bench(tmp_path / "marked", f'<site name="disc" type="cylinder" {shape}/>', DISC)
    welded = bench(
        tmp_path / "welded", f'<body><geom type="cylinder" {shape} mass="0.4" contype="0"/></body>'
    )
    point = bench(tmp_path / "point", f'<site name="disc" size="1e-4" pos="0 0 {-HANGS}"/>', DISC)
    told = Run(np.array([[0.8, -0.8]] * 2).repeat(30, axis=1)[..., None], period=0.01)
    settings = {
        robot: np.array([[*robot.context_defaults[-len(robot.settings) :]]] * 2) for robot in (marked, point)
    }
    for own in settings.values():
        own[1, -1] = 0.4

    def states(robot: Robot) -> np.ndarray:
        run = replace(told, settings=settings.get(robot))
        return rollout(robot, robot.space.nominal[None], run, engine=engine).states[0, :, :, 0]

    plain, loaded = states(marked)
    np.testing.assert_allclose(loaded, states(welded)[0], atol=1e-9)
    assert np.abs(plain - loaded).max() > 0.05
    inertia = np.abs(states(point)[1] - loaded).max()
    assert inertia > 0.005


def bench(folder: Path, inside: str, toml: str = "") -> Robot:
    """The servo bench with something more on its rod."""
    shutil.copytree(packaged_robots()["servo_pendulum"], folder)
    model, said = folder / "model.xml", folder / "robot.toml"
    text = model.read_text(encoding="utf-8")
    assert '<body name="tip"' in text
    model.write_text(text.replace('<body name="tip"', f'{inside}<body name="tip"'), encoding="utf-8")
    said.write_text(
        said.read_text(encoding="utf-8").replace('name = "servo_pendulum"', 'name = "bench"') + toml,
        encoding="utf-8",
    )
    return load_robot(folder)
