"""Configurations of simulators: their identity, and the effects in them as terms for a rollout."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Term, Terms, effect
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot

EFFECTS = {
    "stribeck_friction[arm]": {"velocity": 0.3, "extra": 0.03, "coulomb": 0.01},
    "payload": {"mass": 0.1},
}
ROBOT = load_robot("servo_pendulum")


def config(effects: dict) -> SimConfig:
    robot = ROBOT
    return SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), effects)


def test_terms_are_those_of_one_simulator_with_values_in_the_effects_order() -> None:
    terms = terms_of(config(EFFECTS), ROBOT)
    assert [term.key for term in terms.terms] == list(EFFECTS)
    np.testing.assert_array_equal(terms.values[0], [[0.03, 0.01, 0.3]])
    np.testing.assert_array_equal(terms.values[1], [[0.1]])


def test_a_stored_simulator_rolls_out_with_its_effects() -> None:
    robot, stored = load_robot("servo_pendulum"), config(EFFECTS).as_dict() | {"lineage": {"made_by": "test"}}
    read = SimConfig.from_dict(stored)
    assert read == config(EFFECTS) and read.id == config(EFFECTS).id
    run = excitation(robot, seed=0, episodes=2, steps=30)
    values = robot.space.from_dict(read.values)[None]
    made = rollout(robot, values, run, terms=terms_of(read, robot)).states
    spelt = Terms(
        (Term(effect("stribeck_friction"), ("arm",)), Term(effect("payload"))),
        (np.array([[0.03, 0.01, 0.3]]), np.array([[0.1]])),
    )
    np.testing.assert_array_equal(made, rollout(robot, values, run, terms=spelt).states)
    assert np.abs(made - rollout(robot, values, run).states).max() > 0.01


def test_without_effects_nothing_changes() -> None:
    robot, plain = load_robot("servo_pendulum"), config({})
    assert terms_of(plain, robot) == Terms()
    run = excitation(robot, seed=0, episodes=1, steps=20)
    values = robot.space.nominal[None]
    np.testing.assert_array_equal(
        rollout(robot, values, run, terms=terms_of(plain, robot)).states, rollout(robot, values, run).states
    )


@pytest.mark.parametrize(
    "effects, says",
    [
        ({"rust": {"size": 1.0}}, "rust"),
        ({"payload": {"weight": 1.0}}, "payload"),
        ({"payload[tip]": {"share": 0.1}}, "payload"),
        ({"payload": {}}, "payload"),
        ({"payload[": {"mass": 0.1}}, "payload"),
    ],
)
def test_what_is_no_effect_is_refused(effects: dict, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        terms_of(config(effects), ROBOT)


def test_cogging_of_before_it_had_a_count_has_twelve():
    """What was stored with a sine and a cosine alone is the simulator that it was."""
    (values,) = terms_of(config({"cogging": {"sine": 0.01, "cosine": -0.02}}), ROBOT).values
    assert values.tolist() == [[0.01, -0.02, 12.0]]
    with pytest.raises(UsageError, match="cogging.*one for each of.*sine.*cosine.*count"):
        terms_of(config({"cogging": {"sine": 0.01}}), ROBOT)
