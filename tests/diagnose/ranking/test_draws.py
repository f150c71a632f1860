"""Draws: every term in turn, sizes from half the weak to beyond the strong one, each entry by its number alone."""

import numpy as np
import pytest

from dynreg.diagnose.ranking.draws import LEAST, MOST, NONE_OF, drawn
from dynreg.evidence.hypothesis import Coordinates, effect_bounds, single_terms
from dynreg.evidence.model import Model
from dynreg.replay.known import nominal_known
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot


@pytest.fixture(scope="module")
def servo() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def model(servo: Robot) -> Model:
    return Model(servo, Coordinates(servo, nominal_known(servo)))


def test_every_term_comes_in_turn_and_some_entries_have_none(servo: Robot, model: Model) -> None:
    terms = single_terms(servo)
    count = NONE_OF * len(terms)
    keys = [p.hypothesis.key for p in drawn(model, terms, range(count), 0)]
    assert keys.count("") == count // NONE_OF
    assert {keys.count(t.key) for t in terms} == {NONE_OF - 1}


def test_an_entry_does_not_depend_on_the_others(servo: Robot, model: Model) -> None:
    terms = single_terms(servo)
    every, some = drawn(model, terms, range(20), 4), drawn(model, terms, [7, 13], 4)
    assert [p.hypothesis.key for p in some] == [every[i].hypothesis.key for i in (7, 13)]
    assert np.array_equal(some[0].z, every[7].z) and np.array_equal(some[1].z, every[13].z)
    assert not np.array_equal(drawn(model, terms, [7], 5)[0].z, every[7].z)


def test_sizes_reach_from_below_weak_to_beyond_strong_evenly_in_their_logarithm(model: Model) -> None:
    friction = term("coulomb_friction")
    (p,) = friction.effect.parameters
    points = drawn(model, [friction], range(1000), 0)
    sizes = np.array([q.effect[0] for q in points if len(q.effect)]) * p.medium
    assert LEAST * p.weak * 0.7 < sizes.min() < p.weak
    assert p.strong < sizes.max() < MOST * p.strong * 1.45
    middle = np.sqrt(LEAST * p.weak * MOST * p.strong)
    assert 0.4 < np.mean(sizes < middle) < 0.6


def test_signs_are_even_and_all_stays_within_its_bounds(servo: Robot, model: Model) -> None:
    offset = term("encoder_offset")
    signs = [np.sign(q.effect[0]) for q in drawn(model, [offset], range(500), 1) if len(q.effect)]
    assert abs(np.mean(signs)) < 0.2
    for point in drawn(model, single_terms(servo), range(300), 2):
        low, high = effect_bounds(point.hypothesis).T
        assert ((low <= point.effect) & (point.effect <= high)).all()
        first, last = model.coordinates.nominal_bounds.T
        assert ((first <= point.nominal) & (point.nominal <= last)).all()
