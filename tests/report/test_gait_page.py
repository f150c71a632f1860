"""What the page of a gait draws."""

import re

import made_up_gait

from dynreg.report.gait import best_so_far, page
from dynreg.results import GaitStep


def test_the_best_value_rises_in_stairs_and_begins_with_the_first_gait() -> None:
    """A value below 0 is not drawn as coming from 0."""
    history = (GaitStep(evaluations=3, value=-0.5), GaitStep(evaluations=120, value=0.9))
    result = made_up_gait.gait().model_copy(update={"history": history})
    assert best_so_far(result) == ([3, 120, 120, 242], [-0.5, -0.5, 0.9, 0.9])


def test_feet_are_those_of_the_first_simulator_in_which_it_stood() -> None:
    drawn = page(made_up_gait.gait(fell=True))
    (foot, spans), *_ = drawn["steps"]
    assert foot == "fl_foot" and len(spans) == 2
    left, width = spans[0]  # 0 to 1.5 s of 1 to 4 s
    assert left == 0.0 and abs(width - 100 * 0.5 / 3.0) < 1e-9
    assert len(drawn["ways"]) == 3 and len(drawn["joints"]) == 2


def test_a_score_without_a_unit_shows_none() -> None:
    found = made_up_gait.gait().model_copy(update={"unit": "1"})
    rounds = made_up_gait.rounds().model_copy(update={"unit": "1"})
    told = (str(found), found.brief(), str(rounds), rounds.rounds[-1].outcome("1"))
    assert not [text for text in told if re.search(r"\d 1\b", text)]
