from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_robot import parameter
from mujoco.batch import Batch

from dynreg.errors import RobotError
from dynreg.sim.engines.mujoco_model import configure
from dynreg.sim.fields import link_length, modify, set_field
from dynreg.sim.ports import Ports
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.sets import combine, matching, parse


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("mj.body_mass[tip] =", ("mj", "body_mass", ("tip",), None, "=")),
        ("mj.geom_friction[ground, *_foot][0] *=", ("mj", "geom_friction", ("ground", "*_foot"), 0, "*=")),
        ("mj.opt.gravity[2]+=", ("mj", "opt.gravity", ("2",), None, "+=")),
        ("port.drive.gain[*] *=", ("port", "drive.gain", ("*",), None, "*=")),
        ("port.drive.lag[base/speed_command] =", ("port", "drive.lag", ("base/speed_command",), None, "=")),
        ("control.max_step =", ("control", "max_step", (), None, "=")),
        ("modifier.link_length[*_upper] =", ("modifier", "link_length", ("*_upper",), None, "=")),
    ],
)
def test_every_form_is_read(text: str, parts: tuple):
    a = parse(text)
    assert (a.root, a.path, a.elements, a.index, a.op) == parts


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "TARGET OP"),
        ("mj.body_mass[tip]", "TARGET OP"),
        ("mj.body_mass[tip =", "TARGET OP"),
        ("mj.body_mass[tip] -=", "TARGET OP"),
        ("body_mass[tip] =", "TARGET OP"),
        ("mj.__class__ = 3", "TARGET OP"),
        ("port.drive.gian[*] =", "'gian'.*gain"),
        ("port.drives.gain[*] =", "'drives'.*drive"),
        ("port.gain =", "'gain'.*drive"),
        ("control.speed =", "'speed'.*rate"),
        ("modifier.length[a] =", "'length'.*link_length"),
        ("modifier.gravity[arm] =", "whole robot.*'modifier.gravity ='"),
        ("control.rate[j] *=", "whole robot.*'control.rate \\*='"),
        ("port.base.track[left] =", "whole robot.*'port.base.track ='"),
        ("port.friction.coulomb[j][3] =", r"no index \[3\]"),
        ("modifier.link_length[arm][2] *=", r"no index \[2\]"),
        ("mj.opt.gravity[2][1] =", r"no index \[1\]"),
    ],
)
def test_what_is_no_entry_is_refused(text: str, said: str):
    with pytest.raises(RobotError, match=said):
        parse(text)


@pytest.mark.parametrize(("op", "expected"), [("=", [5.0, 7.0]), ("+=", [7.0, 10.0]), ("*=", [10.0, 21.0])])
def test_operators(op: str, expected: list[float]):
    old = np.array([[[2.0, 2.0]], [[3.0, 3.0]]])  # two simulations, one row, two columns
    new = combine(op, old, np.array([5.0, 7.0]))
    np.testing.assert_array_equal(new, np.broadcast_to(np.reshape(expected, (2, 1, 1)), (2, 1, 2)))


def _configured(robot: Robot, values: np.ndarray) -> tuple[Batch, Ports]:
    batch = Batch(robot.model, len(values))
    return batch, configure(robot, batch, robot.model, values, Run(np.zeros((1, 1, 2))))


FIELDS = {  # entry: what two simulations at 2 and 3 hold, (field, index, expected)
    "mj.body_mass[lower] =": ("body_mass", 2, [2.0, 3.0]),
    "mj.body_mass[lower] +=": ("body_mass", 2, [2.25, 3.25]),
    "mj.body_mass[lower] *=": ("body_mass", 2, [0.5, 0.75]),
    "mj.body_pos[lower][0] =": ("body_pos", (2, 0), [2.0, 3.0]),
    "mj.dof_damping[shoulder] =": ("dof_damping", 0, [2.0, 3.0]),
    "mj.jnt_range[shoulder][1] =": ("jnt_range", (0, 1), [2.0, 3.0]),
    "mj.geom_size[upper][0] *=": ("geom_size", (1, 0), [0.04, 0.06]),
    "mj.qpos_spring[elbow] =": ("qpos_spring", 1, [2.0, 3.0]),
    "mj.opt.gravity[0] =": ("opt.gravity", 0, [2.0, 3.0]),
    "modifier.gravity =": ("opt.gravity", 2, [-2.0, -3.0]),
    "modifier.mass[lower] *=": ("body_inertia", (2, 1), [0.002, 0.003]),
    "modifier.link_length[upper] *=": ("body_pos", (2, 0), [0.4, 0.6]),
    "modifier.link_length[upper] =": ("body_pos", (2, 0), [2.0, 3.0]),
}


@pytest.mark.parametrize("entry", FIELDS)
def test_model_fields_get_their_values(entry: str, write_robot: Callable[..., Path]):
    robot = load_robot(write_robot(parameters=parameter("p", entry, high=4.0)))
    batch, _ = _configured(robot, np.array([[2.0], [3.0]]))
    field, index, expected = FIELDS[entry]
    at = index if isinstance(index, tuple) else (index,)
    np.testing.assert_allclose(batch.expand(field)[(slice(None), *at)], expected)


def test_a_longer_link_has_longer_capsules():
    robot = load_robot("quadruped")
    values = np.tile(robot.space.nominal, (2, 1))
    values[1, robot.space.names.index("upper_length")] *= 1.1
    batch, _ = _configured(robot, values)
    upper, size = robot.model.geom("fl_upper").id, batch.expand("geom_size")
    np.testing.assert_allclose(size[1, upper, :2] / size[0, upper, :2], [1.0, 1.1])
    np.testing.assert_allclose(batch.expand("geom_rbound")[:, upper], size[:, upper, :2].sum(axis=1))


MARKED = """
<mujoco><worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
<body name="arm"><joint name="j" axis="0 1 0"/><geom type="sphere" size="0.1" pos="0 0 -0.3" mass="0.5"/>
  <body name="tool0" pos="0 0 -0.3"/></body></worldbody></mujoco>
"""


def _modified(entry: str, values: list[float]) -> Batch:
    model = mujoco.MjModel.from_xml_string(MARKED)
    batch = Batch(model, len(values))
    modify(batch, model, parse(entry), np.array(values))
    return batch


def test_all_elements_are_those_without_a_name_too():
    names = ["floor", "", "left_foot"]
    assert matching(names, ("*",), "any").tolist() == matching(names, (), "any").tolist() == [0, 1, 2]
    assert matching(names, ("*o*",), "any").tolist() == [0, 2]
    assert matching(["", ""], ("*",), "any").tolist() == [0, 1]
    for patterns in ((), ("?*",)):
        with pytest.raises(RobotError, match="the model names none"):
            matching([""] * len(patterns), patterns, "any")


def test_all_geoms_of_a_model_get_a_friction():
    """The sphere of the arm has no name, as geoms seldom have."""
    model = mujoco.MjModel.from_xml_string(MARKED)
    batch = Batch(model, 1)
    set_field(batch, model, parse("mj.geom_friction[*][0] ="), np.array([0.1]))
    np.testing.assert_array_equal(batch.expand("geom_friction")[0, :, 0], [0.1, 0.1])


def test_a_factor_on_masses_leaves_bodies_without_mass_as_they_are():
    """Frames such as tool0 weigh nothing, in models from URDF."""
    batch, inertia = _modified("modifier.mass[*] *=", [1.0, 3.0]), 0.4 * 0.5 * 0.1**2
    np.testing.assert_array_equal(batch.expand("body_mass"), [[0, 0.5, 0], [0, 1.5, 0]])
    np.testing.assert_allclose(
        batch.expand("body_inertia")[:, :, 0], [[0, inertia, 0], [0, 3 * inertia, 0]], rtol=1e-12
    )


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("modifier.mass[tool0] =", r"'tool0' has no mass.*'\*='.*'modifier.added_mass\[tool0\] \+='"),
        ("modifier.mass[*] +=", "'tool0' has no mass"),
        ("modifier.mass[world] *=", "nothing is named 'world'.*arm"),
        ("modifier.link_length[world] *=", "nothing is named 'world'.*arm"),
    ],
)
def test_bodies_whose_mass_or_length_nothing_can_set_are_refused(entry: str, said: str):
    with pytest.raises(RobotError, match=said):
        _modified(entry, [1.0])


def test_rows_that_are_not_named_stay(write_robot: Callable[..., Path]):
    robot = load_robot(write_robot(parameters=parameter("p", "mj.body_mass[u*] =", high=4.0)))
    batch, _ = _configured(robot, np.array([[2.0], [3.0]]))
    np.testing.assert_allclose(batch.expand("body_mass"), [[0, 2.0, 0.25], [0, 3.0, 0.25]])
    assert robot.model.body_mass[1] == 0.4  # the shared model is left alone


def test_ports_get_their_values(write_robot: Callable[..., Path]):
    entries = (
        "port.drive.gain[shoulder] *=",
        "port.friction.coulomb[*] =",
        "port.drive.torque_limit[elbow/torque] =",
        "control.rate =",
        "control.noise +=",
    )
    robot = load_robot(write_robot(parameters=parameter("p", *entries, high=4.0)))
    _, ports = _configured(robot, np.array([[2.0], [3.0]]))
    np.testing.assert_allclose(ports.drive["gain"], [[40, 0.5], [60, 0.5]])
    np.testing.assert_allclose(ports.friction["coulomb"], [[2, 2], [3, 3]])
    np.testing.assert_allclose(ports.drive["torque_limit"], [[4, 2], [4, 3]])
    np.testing.assert_allclose([ports.control["rate"], ports.control["noise"]], [[2, 3], [2, 3]])


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("mj.body_mas[lower] =", "body_mas"),
        ("mj.body_mass[lowr] =", "'lowr'.*upper"),
        ("mj.body_pos[lower][3] =", "no such index"),
        ("mj.body_mass[lower][0] =", "no such index"),
        ("mj.opt.gravity[z] =", "no such index"),
        ("mj.key_qpos[home] =", "key"),
        ("modifier.mass[arm] =", "'arm'.*upper"),
        ("port.drive.gain[wrist] =", "'wrist'.*shoulder"),
        ("port.drive.gain[wrist/target] =", "'wrist/target'.*shoulder/target"),
    ],
)
def test_names_that_lead_nowhere_are_refused(entry: str, said: str, write_robot: Callable[..., Path]):
    robot = load_robot(write_robot(parameters=parameter("p", entry)))
    with pytest.raises(RobotError, match=said):
        _configured(robot, np.array([[1.0]]))


def test_a_link_without_length_cannot_be_scaled():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="b"><joint/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(RobotError, match="'b' has no length"):
        link_length(model, 1)
