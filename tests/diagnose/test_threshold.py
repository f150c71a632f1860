"""Thresholds: their robots lack nothing of the simulator begun with, their keys tell what the scores depend on."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from dynreg.data.recording import Recording
from dynreg.diagnose.effort import FULL, Effort
from dynreg.evidence.hypothesis import single_terms
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.threshold import USUAL, key_of, null_robot, null_score
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.replay.parts import Parts
from dynreg.sim.config import SimConfig
from dynreg.sim.effects import Term, term
from dynreg.sim.robot import Robot, load_robot

OFFERED = ("cogging", "load_friction", "payload")


@dataclass(frozen=True)
class Case:
    """What a threshold is found for."""

    problem: Problem
    terms: list[Term]
    split: Parts
    runs: int = 2
    seed: int = 0
    effort: Effort = FULL

    @property
    def key(self) -> dict[str, Any]:
        of = {"runs": self.runs, "seed": self.seed, "effort": self.effort}
        return key_of(self.problem, self.terms, self.split, **of)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def recording(robot: Robot) -> Recording:
    return log_of(robot, hide(robot, (), None, 3), protocol(robot, seed=1, seconds=12.5), engine="mujoco")


@pytest.fixture(scope="module")
def case(robot: Robot, recording: Recording) -> Case:
    return posed(robot, recording)


def posed(robot: Robot, recording: Recording, start: SimConfig | None = None, **asked: Any) -> Case:
    problem, split = pose(
        robot, recording, DiagnosisOptions(**{"hold_out": "test_0", "threads": 1} | asked), start
    )
    return Case(problem, single_terms(robot, OFFERED), split)


def started(robot: Robot, size: float = 0.05, **values: float) -> SimConfig:
    """The nominal robot with cogging and these parameters."""
    nominal = robot.space.as_dict(robot.space.nominal)
    (first, *others) = term("cogging").effect.parameters
    sizes = {first.name: size} | {p.name: p.medium for p in others}
    return SimConfig(robot.hash, robot.name, nominal | values, {"cogging": sizes})


def moved(case: Case, joints: tuple[str, ...]) -> Case:
    windows = case.problem.windows
    other = replace(windows, run=replace(windows.run, joints=joints))
    return replace(case, problem=replace(case.problem, windows=other))


def parted(case: Case, fits: int) -> Case:
    """The first windows are those to fit, the others those to select by."""
    fit = np.arange(len(case.split.fit)) < fits
    return replace(case, split=replace(case.split, fit=fit, select=~fit, test=np.zeros_like(fit)))


CHANGES: dict[str, Callable[[Case, Robot, Recording], Case]] = {
    "tolerance": lambda c, robot, log: posed(robot, log, tolerance=2.0),
    "seed": lambda c, robot, log: replace(c, seed=1),
    "runs": lambda c, robot, log: replace(c, runs=3),
    "joints": lambda c, robot, log: moved(c, robot.driven[:1]),
    "engine": lambda c, robot, log: replace(c, problem=replace(c.problem, engine=other_engine(c.problem))),
    "effects offered": lambda c, robot, log: replace(c, terms=c.terms[:-1]),
    "effects of the start": lambda c, robot, log: posed(robot, log, started(robot)),
    "effort": lambda c, robot, log: replace(c, effort=Effort(iterations=1)),
    "commands": lambda c, robot, log: posed(robot, log, horizon=1.0),
}


def other_engine(problem: Problem) -> str:
    return next(name for name in problem.robot.engines if name != problem.running)


@pytest.mark.parametrize("what", CHANGES)
def test_what_scores_depend_on_gives_another_key(what: str, case: Case, robot: Robot, recording: Recording):
    assert CHANGES[what](case, robot, recording).key != case.key


def test_the_same_windows_parted_elsewhere_give_another_key(case: Case):
    assert parted(case, 2).key != parted(case, 3).key


def test_other_sizes_or_parameters_of_the_start_give_another_key(robot: Robot, recording: Recording):
    parameter = next(p for p in robot.space.parameters if np.isfinite(p.tolerance) and not p.known)
    starts = [
        started(robot),
        started(robot, size=0.06),
        started(robot, **{parameter.name: 1.1 * parameter.nominal}),
    ]
    keys = [json.dumps(posed(robot, recording, start).key) for start in starts]
    assert len({*keys}) == 3


def test_the_same_problem_posed_again_gives_the_same_key_of_plain_json(case, robot, recording):
    assert posed(robot, recording).key == case.key == json.loads(json.dumps(case.key))


def test_robots_that_lack_nothing_are_drawn_about_the_start_and_have_its_effects(robot, recording):
    parameter = next(p for p in robot.space.parameters if np.isfinite(p.tolerance) and not p.known)
    index = robot.space.parameters.index(parameter)
    off = parameter.nominal * (1.0 + 3.0 * parameter.tolerance)
    start = started(robot, size=0.05, **{parameter.name: off})
    problem = posed(robot, recording, start).problem
    drawn = [null_robot(problem, seed) for seed in range(30)]
    assert all([t.key for t in one.terms] == ["cogging"] for one in drawn)
    assert all(one.values[0] == pytest.approx([*start.effects["cogging"].values()]) for one in drawn)
    values = [one.parameters[index] for one in drawn]
    assert np.median(values) == pytest.approx(off, abs=1.5 * parameter.tolerance * parameter.nominal)


def test_without_a_start_they_are_drawn_about_the_nameplate_and_have_no_effects(case, robot):
    one, same = null_robot(case.problem, 7), hide(robot, (), None, 7)
    assert one.terms == () and one.values == ()
    assert np.array_equal(one.parameters, same.parameters)


def test_effects_beyond_what_a_fit_reaches_are_simulated_as_far_as_it_does(robot, recording):
    problem = posed(robot, recording, started(robot, size=1e4)).problem
    most = problem.coordinates.effect_values(problem.start.hypothesis, problem.start.effect[None])[0][0]
    assert null_robot(problem, 0).values[0] == pytest.approx(most) and most[0] < 1e4


def test_an_effect_of_the_start_is_no_cause_that_a_simulated_robot_lacks(robot, recording):
    case = posed(robot, recording, started(robot, size=0.07))
    assert null_score(case.problem, [term("cogging")], case.split, 3) < USUAL
