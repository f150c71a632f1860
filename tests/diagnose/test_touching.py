"""Contacts come and go only where something can touch: a robot on its stand is searched as a smooth one."""

from dataclasses import replace

import pytest

from dynreg.diagnose import problem
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Long
from dynreg.diagnose.pose import pose
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.effects.contact import can_touch
from dynreg.sim.robot import load_robot
from dynreg.sim.stand import on_stand


@pytest.mark.parametrize("robot, touches", [("quadruped", True), ("leg", True), ("six_joint_arm", False)])
def test_what_can_touch(robot: str, touches: bool) -> None:
    assert can_touch(load_robot(robot)) is touches


def test_what_touches_nothing_is_not_searched_as_what_slips(monkeypatch: pytest.MonkeyPatch) -> None:
    """However rough its derivatives are: a speed limit bends them as well."""

    def rough(*_):
        yield from ()
        return True

    monkeypatch.setattr(problem, "uneven", rough)
    stand = on_stand(load_robot("quadruped"))
    plan = protocol(stand, seconds=10.0, episode=2.0)
    plan = replace(plan, run=replace(plan.run, initial=None))
    model, data = pose(stand, log_of(stand, hide(stand, (), None, 1), plan), DiagnosisOptions())
    made = run(problem.planned(model, data, single_terms(stand)))
    assert isinstance(made.plan, Long) and not made.model.accuracy.fine
    leg = load_robot("leg")
    plan = protocol(leg, seconds=10.0, episode=2.0)
    model, data = pose(leg, log_of(leg, hide(leg, (), None, 1), plan), DiagnosisOptions())
    assert run(problem.planned(model, data, single_terms(leg))).model.accuracy.fine
