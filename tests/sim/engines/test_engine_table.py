"""Every engine of the table is a `simulate` of one signature, and traits say what a robot can do."""

from importlib import import_module
from inspect import signature

import pytest

from dynreg.errors import UsageError
from dynreg.sim.engine import ENGINES, engines_with
from dynreg.sim.robot import load_robot, packaged_robots


@pytest.mark.parametrize("name", ENGINES)
def test_engines_are_called_alike(name: str):
    mine = signature(import_module(ENGINES[name].module).simulate)
    assert list(mine.parameters) == ["robot", "values", "run", "threads", "terms"]


def test_an_engine_on_a_plane_has_no_contacts():
    assert not {*engines_with("planar")} & {*engines_with("contacts")}


@pytest.mark.parametrize("name", packaged_robots())
def test_a_robot_runs_on_its_first_engine_and_on_no_other_than_its_own(name: str):
    robot = load_robot(name)
    assert [robot.running(), *robot.engines] == [robot.file.robot.engines[0], *robot.file.robot.engines]
    assert robot.planar == {*robot.engines}.issubset(engines_with("planar"))
    with pytest.raises(UsageError, match="no engine 'steam'"):
        robot.running("steam")
