"""A leg on the ground: what a foot that touches it hides is found by rollouts with the finer time step."""

from dataclasses import replace

import numpy as np

from dynreg.diagnose.diagnose import search
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Contact
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.threshold import Threshold, known
from dynreg.evidence.accuracy import rough
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.likelihood import objective
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

ASKED = DiagnosisOptions(hold_out="test_0", threads=1, max_causes=1)


def test_a_payload_on_the_ground_is_named_and_its_simulator_fitted_finely():
    robot = load_robot("leg")
    plan = protocol(robot, seed=1, seconds=5.0, episode=1.0, reach=1.0)
    plan = replace(plan, run=replace(plan.run, settings=np.full_like(plan.run.settings, 0.2)))
    log = log_of(robot, hide(robot, (term("payload"),), "strong", 11), plan)
    model, data = pose(robot, log, ASKED)
    model = replace(model, accuracy=rough(robot))
    terms = single_terms(robot, ("payload", "coulomb_friction"))
    found = run(
        search(Problem(model, data, tuple(terms), Contact()), log, known(Threshold(20.0, ())), ASKED)
    ).found
    assert found.accepted == 1 and [t.key for t in found.current.hypothesis.terms] == ["payload"]
    every = data.sample(data.both)
    points = [model.start, found.base, found.rounds[0].chosen.point, found.current]
    made = run(model.fine.residuals(points, every))
    cost = objective(points, made, every.reweighted(made[-1]))
    assert cost[1] < cost[0] and cost[2] < cost[1] and cost[3] <= cost[2]
