"""Facts that two places state, because one cannot take them from the other: both say the same."""

import re
from typing import get_args

import pytest

from dynreg.cli import completion
from dynreg.compare.compare import CUT
from dynreg.neighbours.spending import usual_budget
from dynreg.registry import references, removing
from dynreg.results.stored import EntrySummary
from dynreg.sim.robot import load_robot
from dynreg.verbs import list as listed
from dynreg.verbs.compare import compare
from dynreg.verbs.navigate import navigate
from dynreg.verbs.query import QuerySettings
from dynreg.verbs.settings import options


def test_every_kind_of_stored_thing_is_listed_offered_removed_and_told() -> None:
    assert completion.KINDS == listed.KINDS
    assert {*listed.KINDS} == {*removing.KINDS} == {*references.KINDS} - {"entry"}
    assert {*get_args(EntrySummary.model_fields["kind"].annotation)} == {*references.KINDS}


@pytest.mark.parametrize("verb", [compare, navigate])
def test_help_texts_say_how_the_commands_are_parted(verb) -> None:
    first = round(100 * CUT[1] / CUT[2])
    assert [int(share) for share in re.findall(r"(\d+) %", verb.__doc__) if share != "90"] == [
        first,
        100 - first,
    ]


@pytest.mark.parametrize("noise", [True, False])
def test_the_help_of_a_query_says_what_it_spends(noise: bool, monkeypatch) -> None:
    usual = next(how.usual for one, how in options(QuerySettings) if one.name == "budget")
    least, each, channel, *without = map(int, re.findall(r"\d+", usual))
    robot = load_robot("servo_pendulum")
    channels = ["arm/position", "arm/velocity"] if noise else []
    monkeypatch.setattr("dynreg.neighbours.spending.noisy_channels", lambda robot: channels)
    told = (
        least + each * len(robot.space) + channel * 2 if noise else without[0] + without[1] * len(robot.space)
    )
    assert usual_budget(robot, QuerySettings.k) == told
