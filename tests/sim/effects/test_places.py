"""Effects of bodies: where they are looked for, and what they do there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import RobotError, UsageError
from dynreg.extend.carry import Fields, carriers
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Terms, effects, placed, term
from dynreg.sim.effects.body import carrier
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

LINKS = ("one", "two", "three", "four")
TOML = """
[robot]
name = "chain"
engines = ["mujoco"]
control_rate = 50.0
timestep = 0.002
tools = ["flange"]
[[parameters]]
name = "friction"
unit = "N*m"
nominal = 0.1
low = 0.01
high = 1.0
sets = ["port.friction.coulomb[*] ="]
"""
E = effects()


def model_text(inside: str = '<site name="flange" pos="0.05 0 0.1"/>') -> str:
    """Four links on a fixed base, the second the heaviest; a light hand is welded to the last."""
    text = ""
    for name, mass in zip(LINKS, (1.0, 3.0, 0.8, 0.5), strict=True):
        text += f'<body name="{name}" pos="0 0 0.2"><joint name="{name}" axis="0 1 0"/>'
        text += f'<inertial mass="{mass}" pos="0 0 0.1" diaginertia="0.01 0.01 0.002"/>'
    hand = '<body name="hand" pos="0 0 0.2"><inertial mass="0.1" pos="0 0 0" diaginertia="1e-4 1e-4 1e-4"/></body>'
    motors = "".join(f'<position name="{n}" joint="{n}"/>' for n in LINKS)
    return f"<mujoco><worldbody>{text}{hand}{inside}{'</body>' * 4}</worldbody><actuator>{motors}</actuator></mujoco>"


@pytest.fixture
def chain(tmp_path: Path) -> Robot:
    return made(tmp_path, model_text())


def made(path: Path, model: str, tools: str = '["flange"]') -> Robot:
    (path / "model.xml").write_text(model, encoding="utf-8")
    toml = TOML.replace('["flange"]', tools)
    for name in LINKS:
        toml += f'[[drives]]\njoint = "{name}"\ntype = "position"\ngain = 80.0\nrate_gain = 4.0\n'
        toml += f'[[actions]]\nname = "{name}/target"\nunit = "rad"\nlow = -1.0\nhigh = 1.0\n'
        toml += f'[[channels]]\nname = "{name}/position"\nunit = "rad"\n'
    (path / "robot.toml").write_text(toml, encoding="utf-8")
    return load_robot(path)


def slid(path: Path, *names: str) -> Robot:
    """The chain, in which these joints slide."""
    text = model_text()
    for name in names:
        text = text.replace(f'<joint name="{name}"', f'<joint type="slide" name="{name}"')
    return made(path, text)


def test_hinges_and_slides_share_no_size_of_which_each_has_another_quantity(tmp_path: Path) -> None:
    single = [f"coulomb_friction[{name}]" for name in LINKS]
    mixed = slid(tmp_path, "three", "four")
    assert keys(mixed, "coulomb_friction") == [
        "coulomb_friction[one,two]",
        "coulomb_friction[three,four]",
        *single,
    ]
    assert keys(mixed, "command_delay") == ["command_delay", *(f"command_delay[{name}]" for name in LINKS)]
    (tmp_path / "one").mkdir()
    assert keys(slid(tmp_path / "one", "four"), "coulomb_friction") == [
        "coulomb_friction[one,two,three]",
        *single,
    ]
    (tmp_path / "all").mkdir()
    assert keys(slid(tmp_path / "all", *LINKS), "coulomb_friction") == ["coulomb_friction", *single]


def keys(robot: Robot, effect: str) -> list[str]:
    return [one.key for one in placed(robot, E[effect])]


def test_a_payload_is_looked_for_on_the_heaviest_body_the_outer_ones_and_at_the_tool(chain: Robot) -> None:
    assert keys(chain, "payload") == ["payload", "payload[three]", "payload[four]", "payload[flange]"]
    assert keys(chain, "com_offset") == ["com_offset", "com_offset[three]", "com_offset[four]"]


def test_where_a_chain_branches_only_what_comes_after_counts(tmp_path: Path) -> None:
    text = model_text().replace(
        '<body name="three"',
        '<body name="side"><joint name="side"/><inertial mass="0.2" pos="0 0 0.1" diaginertia="1e-3 1e-3 1e-3"/></body>'
        '<body name="three"',
    )
    assert keys(made(tmp_path, text), "com_offset") == ["com_offset", "com_offset[side]", "com_offset[four]"]


def test_a_floating_base_carries_on_its_base() -> None:
    assert keys(load_robot("quadruped"), "payload") == ["payload"]


@pytest.mark.parametrize("robot", ["servo_pendulum", "simple_pendulum", "emps"])
def test_with_one_body_there_is_one_place(robot: str) -> None:
    assert keys(load_robot(robot), "payload") == ["payload"]


def states(robot: Robot, terms: Terms | None = None) -> np.ndarray:
    told = np.array([[0.6, -0.4, 0.5, -0.3], [-0.5, 0.6, -0.6, 0.4]]).repeat(25, axis=0)
    return rollout(robot, robot.space.nominal[None], Run(told[None]), terms=terms).states[0, 0]


def test_a_payload_at_the_tool_is_a_body_welded_there(chain: Robot, tmp_path: Path) -> None:
    welded = (
        '<site name="flange" pos="0.05 0 0.1"/><body pos="0.05 0 0.1"><geom size="0.005" mass="0.7"/></body>'
    )
    (tmp_path / "loaded").mkdir()
    loaded = made(tmp_path / "loaded", model_text(welded))
    carried = states(chain, Terms((term("payload[flange]"),), (np.array([[0.7]]),)))
    np.testing.assert_allclose(carried, states(loaded), atol=1e-9)
    assert np.abs(carried - states(chain)).max() > 0.02


def test_a_payload_on_a_body_sits_at_that_bodys_centre(chain: Robot, tmp_path: Path) -> None:
    (tmp_path / "loaded").mkdir()
    heavier = 'mass="0.8" pos="0 0 0.1" diaginertia="0.01 0.01 0.002"'
    loaded = made(
        tmp_path / "loaded",
        model_text().replace(heavier, 'mass="1.6" pos="0 0 0.1" diaginertia="0.02 0.02 0.004"'),
    )
    carried = states(chain, Terms((term("payload[three]"),), (np.array([[0.8]]),)))
    np.testing.assert_allclose(carried, states(loaded), atol=1e-9)


def test_a_centre_of_mass_moves_in_the_body_that_is_named(chain: Robot) -> None:
    terms = Terms((term("com_offset[four]"),), (np.array([[0.03]]),))
    arena = Arena(chain, chain.space.nominal[None], Run(np.zeros((1, 1, 4))), terms=terms)
    moved = arena.model(0).body_ipos - chain.model.body_ipos
    assert [chain.model.body(b).name for b in np.flatnonzero(np.abs(moved).max(axis=1))] == ["four"]
    np.testing.assert_allclose(np.linalg.norm(moved), 0.03)


@pytest.mark.parametrize(
    "key, says",
    [
        (
            "payload[nowhere]",
            "no body 'nowhere' moves; expected one of .*'four'.*, or of the tools 'flange'",
        ),
        ("payload[three,four]", "2 places; expected one body"),
        ("com_offset[flange]", "no body 'flange' moves"),
    ],
)
def test_a_place_that_cannot_be_is_refused(chain: Robot, key: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        states(chain, Terms((term(key),), (np.array([[0.1]]),)))


def test_a_tool_that_the_model_does_not_have_is_refused(tmp_path: Path) -> None:
    robot = made(tmp_path, model_text(), '["gripper"]')
    with pytest.raises(RobotError, match=r"no site 'gripper' on a body that moves; expected one of 'flange'"):
        placed(robot, E["payload"])


def test_a_stored_simulator_that_has_it_as_a_share_opens_as_before(chain: Robot) -> None:
    body = carrier(chain)
    old = SimConfig(chain.hash, chain.name, {}, {"payload": {"share": 0.4}})
    terms = terms_of(old, chain)
    np.testing.assert_allclose(terms.values[0], [[0.4 * chain.model.body_mass[body]]])
    model = Arena(chain, chain.space.nominal[None], Run(np.zeros((1, 1, 4))), terms=terms).model(0)
    np.testing.assert_allclose(model.body_mass[body], 1.4 * chain.model.body_mass[body])
    np.testing.assert_allclose(model.body_inertia[body], 1.4 * chain.model.body_inertia[body])


def test_robot_toml_can_say_a_payload_at_a_tool(chain: Robot) -> None:
    values = chain.space.nominal
    (one,) = carriers(Fields.of(chain, values), term("payload[flange]"), np.array([0.7]))
    assert (one.name, one.unit, one.value, one.sets) == (
        "effect_payload_flange",
        "kg",
        0.7,
        ("modifier.added_mass[flange] +=",),
    )
    parameter = replace(
        chain.space.parameters[0],
        name=one.name,
        unit=one.unit,
        nominal=one.value,
        low=one.low,
        high=one.high,
        sets=one.sets,
    )
    space = replace(chain.space, parameters=(*chain.space.parameters, parameter))
    said = replace(chain, space=space)
    effect = Terms((term("payload[flange]"),), (np.array([[0.7]]),))
    np.testing.assert_array_equal(states(said), states(chain, effect))


@pytest.mark.parametrize(
    "entry", ["modifier.added_mass[flange] *=", "modifier.added_mass[hands] +=", "modifier.added_mass +="]
)
def test_an_added_mass_that_cannot_be_is_refused(chain: Robot, entry: str) -> None:
    parameter = replace(chain.space.parameters[0], sets=(entry,))
    with pytest.raises(RobotError, match="'modifier.added_mass"):
        states(replace(chain, space=replace(chain.space, parameters=(parameter,))))
