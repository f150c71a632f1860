"""Evidence that parameters win back, once they are fitted to the select part too, names nothing."""

import numpy as np
import pytest

from dynreg.diagnose.plans.smooth import fitted_to_both
from dynreg.diagnose.score import Naming, Scored
from dynreg.diagnose.threshold import Threshold
from dynreg.diagnose.trial import Trial, Trials, tried
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run
from dynreg.evidence.point import Point
from dynreg.evidence.truth import protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

STICKS = (
    749076444  # a servo without a cause, which sticks in one window of the select part at other parameters
)


@pytest.fixture(scope="module")
def sticking():
    robot = load_robot("servo_pendulum")
    trials = Trials(robot, protocol(robot, seed=3, seconds=50.0), threads=1)
    (one,) = tried(trials, [Trial((), None, STICKS)], Threshold(5.0, ()))
    return one.made


def test_a_window_that_other_parameters_explain_names_no_cause(sticking):
    assert sticking.verdict == "none"
    ranking = sticking.found.rounds[0].ranking
    assert ranking[0].nats < 2.0, "without the rule dry friction has 21 nats"


def test_a_cause_that_explains_nothing_loses_whatever_it_was_said_to_have(sticking):
    state = sticking.found
    start = state.rounds[0].start
    friction = Hypothesis((term("viscous_friction"),))
    cause = Scored(Point(friction, start.point.nominal, np.array([0.0])), 40.0)
    taken = run(fitted_to_both(state.model, Naming(start, (cause,), cause), state.data, 5))
    assert taken.chosen is None and taken.ranking[0].nats < 2.0
