"""Which plan a problem gets, by what its rollouts cost and how rough they are."""

import numpy as np
import pytest
from by_hand import held_against_zero
from legs import in_the_air, over_its_stop

from dynreg.diagnose.plans import LONG, Contact, Feet, Long, Many, Short, plan_for
from dynreg.diagnose.problem import planned
from dynreg.evidence.accuracy import usual
from dynreg.evidence.hypothesis import Coordinates, single_terms
from dynreg.evidence.lockstep import counted, run
from dynreg.evidence.model import Model
from dynreg.sim.robot import load_robot


@pytest.mark.parametrize(
    ("name", "plan"),
    [
        ("servo_pendulum", Short),
        ("diffdrive", Short),
        ("double_pendulum", Long),
        ("so101", Long),
        ("quadruped", Feet),
    ],
)
def test_a_robot_has_the_plan_of_its_kind(name: str, plan: type):
    robot = load_robot(name)
    model = Model(robot, Coordinates(robot, robot.space.nominal), accuracy=usual(robot))
    assert type(plan_for(model, single_terms(robot))) is plan


@pytest.mark.parametrize(("height", "plan"), [(0.5, Long), (0.2, Contact)])
def test_a_leg_has_another_where_its_foot_touches_the_ground(height: float, plan: type):
    model, data, _ = over_its_stop(height)
    problem = run(planned(model, data, single_terms(model.robot)))
    assert type(problem.plan) is plan and problem.model.accuracy.fine is (plan is Contact)
    assert not model.accuracy.fine and problem.data is data


def test_few_effects_make_a_short_list_of_any_robot():
    model, data, _ = in_the_air()
    terms = single_terms(model.robot, ("payload", "gravity_tilt"))
    assert len(terms) < LONG < len(single_terms(model.robot))
    assert type(run(planned(model, data, terms)).plan) is Short


@pytest.mark.parametrize(("name", "plan"), [("quadruped", Short), ("aibo", Many)])
def test_few_effects_of_a_robot_on_its_feet_with_many_parameters_have_a_plan_of_their_own(name, plan):
    robot = load_robot(name)
    model = Model(robot, Coordinates(robot, np.full(len(robot.space), np.nan)), accuracy=usual(robot))
    assert type(plan_for(model, single_terms(robot, ("second_friction_material",)))) is plan
    assert type(plan_for(model, single_terms(robot))) is Feet


def test_an_engine_without_contacts_is_asked_for_nothing():
    model, data = held_against_zero("coulomb_friction")
    problem, many = run(counted(planned(model, data, single_terms(model.robot))))
    assert many == 0 and type(problem.plan) is Short and problem.model is model
