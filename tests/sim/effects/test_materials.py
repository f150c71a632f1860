"""Materials of a robot: groups of geoms, of which a diagnosis can say that one is more slippery than the others."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dynreg.errors import RobotError, UsageError
from dynreg.sim.effects import Term, Terms, effects, placed, term
from dynreg.sim.engines import rollout
from dynreg.sim.engines.arena import Simulations
from dynreg.sim.inspection import check_robot
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.verbs.effects import effects_list

SECOND = effects()["second_friction_material"]
FEET = {"front_paw": 0.15, "left_paw": 0.13, "rear_elbow": -0.15}
XML = """
<mujoco><option gravity="0 0 -9.80665" integrator="implicitfast" cone="elliptic"/><worldbody>
<geom name="floor" type="plane" size="5 5 0.1" friction="0.4 0.005 0.0001"/>
<body name="sled" pos="0 0 0.05">
  <joint name="ahead" type="slide" axis="1 0 0"/><joint name="up" type="slide" axis="0 0 1"/>
  <joint name="nod" axis="0 1 0"/>
  <inertial mass="1" pos="0 0 0.03" diaginertia="0.01 0.01 0.01"/>
  {feet}
  <body name="cart" pos="0 0 0.06"><joint name="cart" type="slide" axis="1 0 0" range="-0.2 0.2"/>
    <inertial mass="0.8" pos="0 0 0" diaginertia="0.001 0.001 0.001"/></body>
</body></worldbody><actuator><position name="cart" joint="cart"/></actuator></mujoco>
"""
TOML = """
[robot]
name = "sled"
engines = ["mujoco"]
control_rate = 50.0
timestep = 0.002

[[drives]]
joint = "cart"
type = "position"
gain = 400.0
rate_gain = 20.0

[[actions]]
name = "cart/target"
unit = "m"
low = -0.15
high = 0.15

[[channels]]
name = "cart/position"
unit = "m"
noise = 0.0005

[[channels]]
name = "ahead/position"
unit = "m"
noise = 0.0005

[[parameters]]
name = "friction"
unit = "1"
nominal = 0.4
low = 0.3
high = 0.6
sets = ["mj.geom_friction[floor][0] ="]
"""
MATERIALS = """
[[materials]]
name = "paw"
geoms = ["*_paw"]

[[materials]]
name = "elbow"
geoms = ["rear_elbow"]
"""


@pytest.fixture
def sled(tmp_path: Path) -> Callable[..., Path]:
    """Writes the folder of a sled that its cart shakes, with other materials."""

    def write(materials: str = MATERIALS) -> Path:
        feet = "".join(
            f'<geom name="{name}" type="sphere" size="0.02" pos="{x} {0.05 * ("left" in name)} -0.03" '
            'mass="0.01" friction="0.2 0.005 0.0001"/>'
            for name, x in FEET.items()
        )
        (tmp_path / "model.xml").write_text(XML.format(feet=feet))
        (tmp_path / "robot.toml").write_text(TOML + materials)
        return tmp_path

    return write


def shaken() -> Run:
    """The cart goes fast forward and back at different rates, so that the sled slides."""
    t = np.arange(150) / 50
    return Run(0.14 * np.sign(np.sin(2 * np.pi * np.array([1.3, 2.1])[:, None, None] * t[:, None])))


def one(key: str, *losses: float) -> Terms:
    return Terms((term(key),), (np.array(losses)[:, None],))


def slid(robot: Robot, *losses: float, key: str) -> np.ndarray:
    """(rows, E, T+1) where the sled of each loss is."""
    values = np.tile(robot.space.nominal, (len(losses), 1))
    return rollout(robot, values, shaken(), threads=1, terms=one(key, *losses)).states[..., 1]


def test_a_loss_on_one_material_changes_only_its_contacts(sled: Callable[..., Path]):
    robot = load_robot(sled())
    run = Run(np.zeros((1, 1, 1)))

    def contacts(terms: Terms | None) -> dict[str, float]:
        made = Simulations(robot, robot.space.nominal[None], run, terms=terms)
        model = made.model(0)
        data = mujoco.MjData(model)
        data.qpos[:] = [0.0, -0.001, 0.0, 0.0]
        mujoco.mj_forward(model, data)
        return {model.geom(int(max(c.geom))).name: float(c.friction[0]) for c in data.contact}

    plain = contacts(None)
    assert plain == pytest.approx(dict.fromkeys(FEET, 0.4))
    assert contacts(one("second_friction_material[paw]", 0.5)) == pytest.approx(
        {"front_paw": 0.2, "left_paw": 0.2, "rear_elbow": 0.4}
    )
    assert contacts(one("second_friction_material[elbow]", 0.5)) == pytest.approx(plain | {"rear_elbow": 0.2})


def test_each_material_has_a_key_and_so_has_the_left_side(sled: Callable[..., Path]):
    """The sled has no feet on its right, and so no sides."""
    keys = ["second_friction_material[paw]", "second_friction_material[elbow]"]
    robot = load_robot(sled())
    assert [t.key for t in placed(robot, SECOND)] == keys
    assert [t.bodies for t in placed(robot, SECOND)] == [("paw",), ("elbow",)]
    (row,) = [r for r in effects_list(robot).effects if r.id == SECOND.id]
    assert row.applies and "'paw'" in row.title and "'elbow'" in row.title
    plain = load_robot(sled(""))
    assert SECOND.why_not(plain) == "no feet on a left side"
    with pytest.raises(UsageError, match=r"no material 'claw'.*one of the materials 'paw', 'elbow'"):
        slid(robot, 0.5, key="second_friction_material[claw]")
    with pytest.raises(UsageError, match="no left side"):
        slid(robot, 0.5, key="second_friction_material")


def test_what_is_said_of_a_material_is_not_said_of_sides(sled: Callable[..., Path]):
    robot = load_robot(sled())
    (row,) = [r for r in effects_list(robot).effects if r.id == SECOND.id]
    (loss,) = row.parameters
    assert "'paw'" in loss.meaning and "'elbow'" in loss.meaning and "left" not in loss.meaning
    assert "'paw'" in row.separate_by and "180" not in row.separate_by
    (plain,) = [r for r in effects_list().effects if r.id == SECOND.id]
    assert plain.parameters[0].meaning == "friction lost on the left" and "180" in plain.separate_by
    paw, elbow = placed(robot, SECOND)
    assert SECOND.separate_by_at(paw.at) != SECOND.separate_by_at(elbow.at)


def test_a_robot_of_one_material_has_no_second_one(sled: Callable[..., Path]):
    robot = load_robot(sled('[[materials]]\nname = "all"\ngeoms = ["*_paw", "*_elbow"]\n'))
    assert SECOND.why_not(robot) == "no feet on a left side"


def test_materials_leave_the_sides_as_they_are(tmp_path: Path):
    """The packaged quadruped with materials moves, with a slippery left side, as without them."""
    quadruped = load_robot("quadruped")
    for name, text in quadruped.files.files.items():
        (tmp_path / name).write_bytes(text)
    toml = tmp_path / "robot.toml"
    toml.write_text(toml.read_text() + '\n[[materials]]\nname = "pads"\ngeoms = ["fl_foot", "rr_foot"]\n')
    both = load_robot(tmp_path)
    keys = [t.key for t in placed(both, SECOND)]
    assert keys == ["second_friction_material", "second_friction_material[pads]"]
    assert [t.key for t in placed(quadruped, SECOND)] == keys[:1]
    run = Run(np.tile([0.1, 0.5, -0.9] * 4, (1, 15, 1)))
    moved = [
        rollout(r, r.space.nominal[None], run, threads=1, terms=one(keys[0], 0.5)).states
        for r in (quadruped, both)
    ]
    np.testing.assert_array_equal(*moved)


def test_the_slippery_material_is_the_likelier_one(sled: Callable[..., Path]):
    """Each material's loss is fitted to a log of a sled whose paws, or elbow, had lost 60 % of their friction."""
    robot = load_robot(sled())
    tried, noise = np.linspace(0.05, 0.95, 19), 0.0005
    for truth, other in (("paw", "elbow"), ("elbow", "paw")):
        (log,) = slid(robot, 0.6, key=f"second_friction_material[{truth}]")
        log = log + noise * np.random.default_rng(5).standard_normal(log.shape)
        nats = {}
        for name in (truth, other):
            left = slid(robot, *tried, key=f"second_friction_material[{name}]") - log
            nats[name] = -0.5 * ((left / noise) ** 2).sum(axis=(1, 2))
        assert tried[nats[truth].argmax()] == pytest.approx(0.6)
        assert nats[truth].max() > nats[other].max() + 20.0


@pytest.mark.parametrize(
    ("materials", "line", "said"),
    [
        ('[[materials]]\nname = "paw"\ngeoms = ["*_pw"]\n', 3, r"material 'paw': no geom is named '\*_pw'"),
        (
            MATERIALS.replace('"rear_elbow"', '"rear_*", "left_*"'),
            8,
            "geom 'left_paw' is of two materials, 'paw'",
        ),
        (MATERIALS.replace('"elbow"', '"paw"'), 7, "'paw' is named twice"),
    ],
)
def test_what_is_wrong_with_materials_is_told_with_its_line(
    sled: Callable[..., Path], materials: str, line: int, said: str
):
    folder = sled(materials)
    at = TOML.count("\n") + line
    with pytest.raises(RobotError, match=f"line {at}.*{said}"):
        load_robot(folder).materials  # noqa: B018 (looks them up)
    found = [f for f in check_robot(folder) if f"line {at}" in f]
    assert len(found) == 1 and "\n" not in found[0]


def test_a_folder_with_materials_is_checked_clean(sled: Callable[..., Path]):
    assert check_robot(sled()) == []


def test_a_key_of_a_material_is_read_back():
    assert term("second_friction_material[paw]") == Term(SECOND, ("paw",))
