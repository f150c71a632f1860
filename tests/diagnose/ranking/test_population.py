"""Populations of effects: hidden causes come first, nothing else does, and what no entry resembles is told."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.diagnose.guided import guided
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Feet
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem, planned
from dynreg.diagnose.ranking.entries import TOGETHER, entries
from dynreg.diagnose.ranking.guide import FIRST, SIZES, Guide
from dynreg.diagnose.ranking.population import EffectPopulation, Ranking, bare, populated
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import counted, run
from dynreg.evidence.point import Point
from dynreg.evidence.truth import Protocol, hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

COUNT = 500
OFFERED = ("load_friction", "torque_limit", "command_delay", "inertia", "backlash", "encoder_scale")


@pytest.fixture(scope="module")
def servo() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def plan(servo: Robot) -> Protocol:
    return protocol(servo, seed=5, seconds=25.0)


def posed(servo: Robot, plan: Protocol, cause: str | None, seed: int = 1, size: str = "medium") -> Problem:
    terms = () if cause is None else (term(cause),)
    recording = log_of(servo, hide(servo, terms, size, seed), plan, engine="joint")
    model, data = pose(servo, recording, DiagnosisOptions(hold_out="test_0"))
    return run(planned(model, data, single_terms(servo, OFFERED)))


@pytest.fixture(scope="module")
def clean(servo: Robot, plan: Protocol) -> Problem:
    return posed(servo, plan, None)


@pytest.fixture(scope="module")
def population(clean: Problem, servo: Robot) -> EffectPopulation:
    return run(populated(clean.model, clean.data, clean.terms, servo, COUNT, 0))


def looked(problem: Problem, population: EffectPopulation) -> Ranking:
    return run(Guide(population).ranking(problem.model, problem.data, problem.terms))


@pytest.mark.parametrize("cause", OFFERED)
def test_the_hidden_cause_comes_first_and_is_known(servo, plan, population, cause) -> None:
    found = looked(posed(servo, plan, cause, seed=11), population)
    assert found.keys[0] == cause
    assert not found.outside and found.resemblance > 0.9


def test_a_robot_without_an_effect_leaves_no_more_than_noise(clean, population) -> None:
    found = looked(clean, population)
    assert 0.5 < found.size / found.noise < 2.0
    assert not found.outside


def test_nothing_looks_like_a_cause_that_no_entry_has(servo, plan, population) -> None:
    hidden = looked(posed(servo, plan, "joint_elasticity", size="strong"), population)
    known = looked(posed(servo, plan, "torque_limit", size="strong"), population)
    assert hidden.outside and not known.outside


def test_terms_that_are_no_candidates_count_for_nothing(servo, plan, population) -> None:
    problem = posed(servo, plan, "torque_limit", size="strong")
    others = tuple(t for t in problem.terms if t.key != "torque_limit")
    found = looked(replace(problem, terms=others), population)
    assert "torque_limit" not in found.keys
    assert found.resemblance < looked(problem, population).resemblance


def test_parameters_within_their_tolerances_are_no_feature(clean, servo) -> None:
    frame = run(bare(clean.model, clean.data))
    z = 1.5 * (-1.0) ** np.arange(len(clean.model.coordinates))
    points = [Point(clean.model.start.hypothesis, z, np.zeros(0))]
    points.append(Point(clean.model.start.hypothesis.with_term(term("torque_limit")), 0 * z, np.ones(1)))
    windows = clean.data.windows.run.take(frame.sample.chosen)
    states = run(clean.model.states(points, windows))
    moved, caused = run(frame.features(states[..., 1:, clean.data.use]))
    before = (
        states[0][..., 1:, clean.data.use]
        - run(clean.model.states([clean.model.start], windows))[0][..., 1:, clean.data.use]
    )
    assert np.linalg.norm(moved) < 0.05 * np.linalg.norm(before / clean.data.spread)
    assert np.linalg.norm(moved) < 0.1 * np.linalg.norm(caused)


def test_an_entry_is_the_same_whatever_is_made_beside_it(clean, servo) -> None:
    frame = run(bare(clean.model, clean.data))
    span = range(TOGETHER - 4, TOGETHER + 4)
    every = run(entries(frame, clean.terms, servo, span, 0))
    some = run(entries(frame, clean.terms, servo, span[3:6], 0))
    for name in ("values", "carried", "effects", "points", "states", "features"):
        assert np.array_equal(getattr(every, name)[3:6], getattr(some, name))


def test_a_population_from_its_arrays_ranks_the_same(clean, population) -> None:
    again = EffectPopulation.from_arrays(population.terms, population.as_arrays())
    one, other = looked(clean, population), looked(clean, again)
    assert [c.key for c in one.causes] == [c.key for c in other.causes]
    assert one.resemblance == other.resemblance
    assert np.allclose([c.share for c in one.causes], [c.share for c in other.causes], atol=1e-4)


def test_hints_are_likely_causes_at_the_sizes_of_their_nearest_entries(servo, plan, population) -> None:
    problem = posed(servo, plan, "torque_limit", seed=11)
    found = looked(problem, population)
    hints = Guide(population).hints(found, problem.model, problem.model.start, problem.terms)
    assert [p.hypothesis.key for p in hints[:SIZES]] == ["torque_limit"] * SIZES
    assert len({p.hypothesis.key for p in hints}) <= FIRST
    assert abs(hints[0].effect[0] - 1.0) < 0.35  # medium was hidden


class Shelf(dict):
    """A cache in memory."""

    def cached(self, kind, key):
        return self.get((kind, repr(key)))

    def cache(self, kind, key, document):
        self[kind, repr(key)] = document


def test_it_is_made_once_for_the_same_commands_and_found_again(servo, plan, clean, monkeypatch) -> None:
    recording = log_of(servo, hide(servo, (), None, 3), plan, engine="joint")
    options, shelf = DiagnosisOptions(hold_out="test_0", ranker="make"), Shelf()
    monkeypatch.setattr("dynreg.diagnose.guided.EACH", 10)
    assert run(guided(clean, recording, replace(options, ranker="auto"), shelf)).guide is None
    made, many = run(counted(guided(clean, recording, options, shelf)))
    again, none = run(counted(guided(clean, recording, replace(options, ranker="auto"), shelf)))
    assert many > 2 * len(made.guide.population) and none == 0
    assert looked(clean, again.guide.population).keys == looked(clean, made.guide.population).keys
    assert run(guided(clean, recording, replace(options, ranker="off"), shelf)).guide is None
    # on feet logs of one cause do not look alike
    feet, asked = replace(clean, plan=Feet()), replace(options, ranker="auto")
    assert run(guided(feet, recording, asked, shelf)).guide is None
    assert run(guided(feet, recording, options, shelf)).guide is not None
