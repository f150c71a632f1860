"""Bodies that MuJoCo would compile as "simple": whatever parameters and effects move in them can be simulated."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from arm_robot import parameter

from dynreg.extend.plain import write_mjcf
from dynreg.sim.effects import Effect, Term, Terms, effects
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.mjcf import compile_model
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

MODEL = """<mujoco>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="cart" pos="0 0 0.1">
      <joint name="rail" type="{joint}" damping="0.1"/>
      <geom name="box" type="box" size="0.1 0.05 0.03" mass="1.2" contype="0" conaffinity="0"/>
      <site name="rack" pos="0.05 0.02 0.03" euler="10 20 30" type="box" size="0.02 0.03 0.04"/>
    </body>
  </worldbody>
  <actuator><motor name="m" joint="rail"/></actuator>
</mujoco>"""
TOML = """
[robot]
name = "cart"
engines = ["mujoco", "joint"]
control_rate = 100.0
timestep = 0.005
tools = ["rack"]

[[drives]]
joint = "rail"
{drive}

[[actions]]
name = "rail/{told}"
unit = "{unit}"

[[channels]]
name = "rail/position"
unit = "{place}"

[[channels]]
name = "rail/velocity"
unit = "{place}/s"

"""
DRIVES = {
    "motor": ('type = "torque"\ngain = 1.0\ntorque_limit = 20.0', "torque"),
    "servo": ('type = "position"\ngain = 20.0\nrate_gain = 0.6\ntorque_limit = 20.0', "target"),
}
JOINTS = {
    "slide": ('slide" axis="1 0 0', "m", "N"),
    "hinge": ('hinge" axis="0 1 0', "rad", "N*m"),
}
SETS = (
    "mj.body_mass[cart] +=",
    "mj.body_inertia[cart][1] +=",
    "mj.body_ipos[cart][0] +=",
    "mj.body_iquat[cart][1] +=",
    "mj.body_pos[cart][2] +=",
    "mj.body_quat[cart][1] +=",
    "mj.body_gravcomp[cart] +=",
    "mj.jnt_pos[rail][0] +=",
    "mj.jnt_axis[rail][2] +=",
    "mj.jnt_stiffness[rail] +=",
    "mj.qpos0[rail] +=",
    "mj.qpos_spring[rail] +=",
    "mj.dof_armature[rail] +=",
    "mj.dof_damping[rail] +=",
    "mj.dof_frictionloss[rail] +=",
    "mj.geom_pos[box][0] +=",
    "mj.geom_size[box][0] +=",
    "mj.site_pos[rack][0] +=",
    "mj.opt.gravity[0] +=",
    "modifier.mass[cart] +=",
    "modifier.added_mass[cart] +=",
    "modifier.added_mass[rack] +=",
    "modifier.gravity +=",
)
EVERY = {e.id: e for e in effects().values()}
ENGINES = ("mujoco", "joint", "arena")


def written(folder: Path, joint: str, drive: str, *sets: str) -> Robot:
    """The cart, on a rail or turning about its centre."""
    kind, place, force = JOINTS[joint]
    law, told = DRIVES[drive]
    unit = place if told == "target" else force
    toml = TOML.format(drive=law, told=told, unit=unit, place=place)
    folder.mkdir()
    (folder / "model.xml").write_text(MODEL.format(joint=kind), encoding="utf-8")
    own = parameter("moved", *(sets or (SETS[0],)), nominal=0.0, low=0.0, high=0.1)
    (folder / "robot.toml").write_text(toml + own, encoding="utf-8")
    return load_robot(folder)


def second(effect: Effect, robot: Robot) -> Terms:
    """The effect, a little of it, in the second of two simulators."""
    values = np.full((2, len(effect.parameters)), np.nan)
    values[1] = [p.weak for p in effect.parameters]
    return Terms((Term(effect, effect.places(robot)[0]),), (values,))


def run_of(robot: Robot) -> Run:
    """Half a second of steps."""
    return Run(np.repeat([0.3, -0.2, 0.5, 0.0, 0.4], 10)[None, :, None])


def states(robot: Robot, engine: str, values: np.ndarray, **options: object) -> np.ndarray:
    """(B, T+1, S) of an engine, or of simulators that are set up once."""
    if engine == "arena":
        return Arena(robot, values, run_of(robot), **options).rollout(run_of(robot)).states[:, 0]
    return rollout(robot, values, run_of(robot), engine=engine, **options).states[:, 0]


@pytest.fixture(scope="module")
def carts(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Robot]:
    root = tmp_path_factory.mktemp("carts")
    return {(j, d): written(root / f"{j}_{d}", j, d) for j in JOINTS for d in DRIVES}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("effect", EVERY)
def test_every_effect_runs_on_such_a_body(effect: str, engine: str, carts: dict[tuple[str, str], Robot]):
    """One row without it, and one with it, in one batch."""
    able = [robot for robot in carts.values() if EVERY[effect].why_not(robot) is None]
    for robot in able:
        if effect == "stand_compliance" and engine != "mujoco":
            continue
        nominal = np.tile(robot.space.nominal, (2, 1))
        assert np.isfinite(states(robot, engine, nominal, terms=second(EVERY[effect], robot))).all()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("entry", SETS)
@pytest.mark.parametrize("joint", JOINTS)
def test_every_entry_of_sets_runs_on_such_a_body(joint: str, entry: str, engine: str, tmp_path: Path):
    robot = written(tmp_path / "cart", joint, "servo", entry)
    assert np.isfinite(states(robot, engine, np.array([[0.0], [0.05]]))).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_centre_of_mass_beside_a_hinge_pulls_at_it(engine: str, carts: dict[tuple[str, str], Robot]):
    """As far as gravity and the moved mass say."""
    robot = carts["hinge", "servo"]
    run = Run(np.zeros((1, 300, 1)))
    terms, shift = second(EVERY["com_offset"], robot).take([1]), EVERY["com_offset"].size.weak
    args = (robot, robot.space.nominal[None])
    if engine == "arena":
        end = Arena(*args, run, terms=terms).rollout(run).states[0, 0, -1, 0]
    else:
        end = rollout(*args, run, engine=engine, terms=terms).states[0, 0, -1, 0]
    assert end == pytest.approx(1.2 * 9.81 * shift / 20.0, rel=1e-3)


def test_what_flexes_are_made_of_stays_simple():
    """Only bodies that parameters and effects name can move: a flex would be slower for nothing."""
    xml = (
        '<mujoco><worldbody><body name="b"><freejoint/><geom size="0.1"/></body><flexcomp type="grid" '
        'count="3 3 3" spacing=".1 .1 .1" name="f" dim="3" mass="1"><edge equality="true"/></flexcomp>'
        "</worldbody></mujoco>"
    )
    plain = mujoco.MjModel.from_xml_string(xml)
    model = compile_model({"m.xml": xml.encode()}, "m.xml")
    assert plain.body_simple[1] == 1 and model.body_simple[1] == 0
    np.testing.assert_array_equal(model.body_simple[2:], plain.body_simple[2:])


def test_a_model_for_mujoco_alone_may_be_moved_as_the_simulator_is(
    tmp_path: Path, carts: dict[tuple[str, str], Robot]
):
    """A trainer writes the fields that the log leaves open, and calls mj_setConst."""
    robot = carts["hinge", "servo"]
    path = tmp_path / "cart.xml"
    (tmp_path / "model.xml").write_bytes(robot.files.files["model.xml"])
    write_mjcf(robot, robot.space.nominal, Terms(), path)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.body_ipos[1] = [0.02, 0.0, 0.0]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    np.testing.assert_allclose(model.dof_invweight0, 1.0 / (1.2 * (0.0109 / 3.0 + 0.02**2)), rtol=1e-9)
