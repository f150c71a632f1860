"""An earlier cause gives way to an equivalent only for its share of the whole evidence, for each parameter more."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynreg.diagnose import settle
from dynreg.diagnose.hypothesis import Hypothesis
from dynreg.diagnose.name import NEAR, Naming, Scored
from dynreg.diagnose.problem import Point
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

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


def revised(rounds: list[Naming], gained: float, monkeypatch: pytest.MonkeyPatch) -> list[Naming]:
    """`rounds` revised where the equivalent, beside the later cause, gains so many nats."""
    monkeypatch.setattr(settle, "fit", lambda problem, points, *a, **k: (points, np.zeros(len(points))))
    ranked = lambda problem, base, fitted, *a: Naming(scored(0.0), [Scored(fitted[0], gained)])  # noqa: E731
    monkeypatch.setattr(settle, "select", ranked)
    windows = np.arange(1)
    return settle.revise(
        SimpleNamespace(robot=load_robot("servo_pendulum")), rounds, windows, windows, np.ones((1, 1))
    )


def needed() -> float:
    more = len(term(RICH).effect.parameters) - len(term(PLAIN).effect.parameters)
    assert more > 0
    return NEAR * 150.0 * (1 + more)


def test_a_richer_equivalent_that_gains_too_little_changes_nothing(rounds, monkeypatch):
    out = revised(rounds, needed() - 0.1, monkeypatch)
    assert [r.chosen.key for r in out] == [r.chosen.key for r in rounds]


def test_a_richer_equivalent_that_gains_enough_takes_the_place_in_every_round(rounds, monkeypatch):
    out = revised(rounds, needed() + 0.1, monkeypatch)
    assert out[0].chosen.key == point(RICH).hypothesis.key
    assert [e.key for e in out[0].equivalent] == [PLAIN]
    assert out[1].chosen.key == point(RICH, LATER).hypothesis.key
    assert out[1].chosen.nats == rounds[1].chosen.nats
    assert rounds[0].chosen.key == PLAIN  # what was given stays as it was
