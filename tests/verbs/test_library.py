"""The library of effects as a result: whole, symmetric, and true to what each robot can have."""

import pytest

from dynreg.sim.effects import applicable, effects
from dynreg.sim.robot import load_robot
from dynreg.verbs.effects import effects_list


def test_every_effect_is_listed_in_the_order_in_which_they_act() -> None:
    assert [e.id for e in effects_list().effects] == list(effects())


def test_exact_groups_are_symmetric() -> None:
    group = {e.id: set(e.group) for e in effects_list().effects}
    for effect, others in group.items():
        assert effect not in others
        for other in others:
            assert group[other] == others - {other} | {effect}
    assert group["command_delay"] == {"sensor_delay"}


def test_what_is_near_is_in_the_library_and_comes_with_its_experiment() -> None:
    listed = effects_list().effects
    ids = {e.id for e in listed}
    for e in listed:
        assert set(e.near) <= ids
        assert e.separate_by or not (e.near or e.group)


@pytest.mark.parametrize("name", ["servo_pendulum", "quadruped", "husky"])
def test_what_a_robot_can_have_is_said_with_why_not(name: str) -> None:
    robot = load_robot(name)
    listed = effects_list(robot)
    assert listed.robot == robot.name
    assert {e.id for e in listed.effects if e.applies} == set(applicable(robot))
    assert all(bool(e.why_not) != e.applies for e in listed.effects)


def test_without_a_robot_nothing_is_said_of_one() -> None:
    assert all(e.applies is None and e.why_not is None for e in effects_list().effects)


def test_sizes_grow_from_weak_to_strong() -> None:
    for e in effects_list().effects:
        size = e.parameters[0]
        values = [abs(v) for v in (size.weak, size.medium, size.strong)]
        assert values in (sorted(values), sorted(values)[::-1]) and len(set(values)) == 3, e.id


@pytest.mark.parametrize(
    ("name", "alike"),
    [("leg", ("encoder_offset",)), ("quadruped", ()), ("simple_pendulum", ("com_offset", "encoder_offset"))],
)
def test_of_a_robot_only_what_is_exact_at_one_of_its_joints_is_a_group(
    name: str, alike: tuple[str, ...]
) -> None:
    (tilt,) = [e for e in effects_list(load_robot(name)).effects if e.id == "gravity_tilt"]
    assert sorted(tilt.group) == sorted(alike)
