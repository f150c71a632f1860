"""An earlier cause gives way to an equivalent only for its share of the whole evidence, for each parameter more."""

import numpy as np
import pytest

from dynreg.diagnose.hypothesis import Hypothesis
from dynreg.diagnose.problem import Point
from dynreg.diagnose.score import NEAR, Naming, Scored
from dynreg.diagnose.settle import exchanged
from dynreg.sim.effects import term

PLAIN, RICH, LATER = "load_friction", "stribeck_load_friction", "thermal_fade"


def point(*keys: str) -> Point:
    terms = tuple(term(k) for k in keys)
    return Point(Hypothesis(terms), np.zeros(2), np.ones(sum(len(t.effect.parameters) for t in terms)))


def scored(nats: float, *keys: str) -> Scored:
    return Scored(point(*keys), nats)


@pytest.fixture
def rounds() -> list[Naming]:
    """Two causes of 100 and 50 nats; the first has an equivalent with more parameters."""
    start = scored(0.0)
    first = Naming(start, [], scored(100.0, PLAIN), [scored(97.0, RICH)])
    return [first, Naming(scored(0.0, PLAIN), [], scored(50.0, PLAIN, LATER))]


def revised(rounds: list[Naming], gained: float) -> list[Naming]:
    """`rounds` revised where the equivalent, beside the later cause, gains so many nats."""
    (other,), beside = rounds[0].equivalent, point(RICH, LATER)
    return exchanged(rounds, 0, [(other, beside)], [Scored(beside, gained)])


def needed() -> float:
    more = len(term(RICH).effect.parameters) - len(term(PLAIN).effect.parameters)
    assert more > 0
    return NEAR * 150.0 * (1 + more)


def test_a_richer_equivalent_that_gains_too_little_changes_nothing(rounds):
    out = revised(rounds, needed() - 0.1)
    assert [r.chosen.key for r in out] == [r.chosen.key for r in rounds]


def test_a_richer_equivalent_that_gains_enough_takes_the_place_in_every_round(rounds):
    out = revised(rounds, needed() + 0.1)
    assert out[0].chosen.key == point(RICH).hypothesis.key
    assert [e.key for e in out[0].equivalent] == [PLAIN]
    assert out[1].chosen.key == point(RICH, LATER).hypothesis.key
    assert out[1].chosen.nats == rounds[1].chosen.nats
    assert rounds[0].chosen.key == PLAIN  # what was given stays as it was
