"""An earlier cause, none that is given, gives way to an equivalent for its share of the evidence alone."""

import numpy as np
import pytest

from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.score import NEAR, Naming, Scored
from dynreg.diagnose.settle import exchange_cause, revise
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run
from dynreg.evidence.point import Point
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

PLAIN, RICH, LATER = "load_friction", "stribeck_load_friction", "thermal_fade"
GIVEN, LAST = "cogging", "payload"


def point(*keys: str, given: int = 0) -> Point:
    terms = tuple(term(k) for k in keys)
    return Point(Hypothesis(terms, given), np.zeros(2), np.ones(sum(len(t.effect.parameters) for t in terms)))


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
    return exchange_cause(rounds, 0, [(other, beside)], [Scored(beside, gained)])


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


def test_what_the_search_began_with_stays_in_its_place_in_every_round():
    """Of three rounds the one between is put together anew, about the effect that is given."""
    at = lambda *keys: point(GIVEN, *keys, given=1)  # noqa: E731
    start, equivalent = Scored(at(), 0.0), Scored(at(RICH), 97.0)
    rounds = [
        Naming(start, [], Scored(at(PLAIN), 100.0), [equivalent]),
        Naming(start, [], Scored(at(PLAIN, LATER), 50.0)),
        Naming(start, [], Scored(at(PLAIN, LATER, LAST), 30.0)),
    ]
    beside = at(RICH, LATER, LAST)
    out = exchange_cause(rounds, 0, [(equivalent, beside)], [Scored(beside, 100.0)])
    hypotheses = [r.chosen.point.hypothesis for r in out]
    assert hypotheses == [at(*keys).hypothesis for keys in ((RICH,), (RICH, LATER), (RICH, LATER, LAST))]
    assert [len(r.chosen.point.effect) for r in out] == [len(h.parameters) for h in hypotheses]


def test_an_earlier_cause_is_exchanged_and_not_the_effect_that_the_search_began_with():
    """The log has cogging (given), Stribeck's friction under load (plain load friction was named) and a payload."""
    robot, terms = load_robot("servo_pendulum"), tuple(term(k) for k in (GIVEN, RICH, LAST))
    hidden = hide(robot, terms, "strong", 11)
    recording = log_of(robot, hidden, protocol(robot, seed=1, seconds=12.5), engine="mujoco")
    model, data = pose(robot, recording, DiagnosisOptions(hold_out="test_0", threads=1))
    c = model.coordinates
    known = {t.key: c.effect_coordinates(t, v) for t, v in zip(terms, hidden.values, strict=True)}
    nominal = c.from_values(hidden.parameters)

    def at(*keys: str) -> Point:
        sizes = [known.get(k, np.ones(len(term(k).effect.parameters))) for k in (GIVEN, *keys)]
        return Point(Hypothesis(tuple(term(k) for k in (GIVEN, *keys)), 1), nominal, np.concatenate(sizes))

    start = Scored(at(), 0.0)
    rounds = [
        Naming(start, [], Scored(at(PLAIN), 100.0), [Scored(at(RICH), 97.0)]),
        Naming(start, [], Scored(at(PLAIN, LAST), 50.0)),
    ]
    sample = data.sample(data.fit)
    sample = sample.reweighted(run(model.residuals([at(RICH, LAST)], sample))[0])
    (first, last) = run(revise(model, rounds, sample))
    assert first.chosen.point.hypothesis == at(RICH).hypothesis
    assert last.chosen.point.hypothesis == at(RICH, LAST).hypothesis
