"""A floating base on its feet: where its terms start, how its derivatives are taken, and what they gain."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from dynreg.diagnose import fit as fitting
from dynreg.diagnose import name, shortlist
from dynreg.diagnose.fit import ROOM, ROUGH, SIDES, fit
from dynreg.diagnose.hypothesis import Hypothesis
from dynreg.diagnose.problem import Point, Problem
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def plain(*z: float) -> Point:
    return Point(Hypothesis(), np.array(z), np.zeros(0))


def hypotheses(*keys: str) -> list[Point]:
    return [Point(Hypothesis((term(key),)), np.zeros(1), np.ones(1)) for key in keys]


def listed(monkeypatch, *, stands: bool, without: float = 1000.0):
    """Where the terms of a list start, with how many iterations, and the points that come of it.

    Payload and gravity_tilt are found from the nameplate at 900 and 950 nats, com_offset, payload and ground_friction
    from the calibrated model at 940, 960 and 999; the model without a term is at `without`.
    """
    asked = []
    payload, tilt, offset, ground = hypotheses("payload", "gravity_tilt", "com_offset", "ground_friction")
    near = [(999.0, ground), (960.0, payload), (940.0, offset)]
    found = {0.0: [(950.0, tilt), (900.0, payload)], 1.0: near}

    def roughly(problem, start, *_, further=0):
        asked.append((start.nominal[0], further))
        return found[start.nominal[0]]

    monkeypatch.setattr(shortlist, "_roughly_from", roughly)
    monkeypatch.setattr(shortlist, "objective", lambda *_: np.array([without]))
    fine = SimpleNamespace(residuals=lambda *_: None)
    problem = SimpleNamespace(rough=True, stands=stands, fine=fine)
    out = shortlist.shortlisted(problem, plain(1.0), [], np.arange(1), np.ones((1, 1)), 3)
    return asked, [point.hypothesis.key for point in out]


def test_a_floating_base_is_searched_from_its_nameplate_where_the_best_go_on_and_from_the_calibrated_model(
    monkeypatch,
):
    asked, keys = listed(monkeypatch, stands=True)
    assert asked == [(0.0, shortlist.FURTHER), (1.0, 0)]
    assert keys == ["payload", "com_offset", "gravity_tilt"]  # in turn; 999 is no gain on 1000


def test_other_rough_robots_are_searched_from_both_and_their_terms_sorted_together(monkeypatch):
    asked, keys = listed(monkeypatch, stands=False)
    assert asked == [(1.0, 0), (0.0, 0)]
    assert keys == ["payload", "com_offset", "gravity_tilt", "ground_friction"]


def test_what_is_clear_from_the_nameplate_is_not_sought_from_the_calibrated_model_too(monkeypatch):
    asked, keys = listed(monkeypatch, stands=True, without=900.0 + shortlist.CLEAR + 1.0)
    assert asked == [(0.0, shortlist.FURTHER)] and keys == ["payload", "gravity_tilt"]


@dataclass
class Bent:
    """A floating base whose one residual is z^2; its derivatives are those of z^3."""

    power: float = 2.0
    stands: bool = True
    rough: bool = True
    low: float = -9.0

    def __post_init__(self):
        self.coordinates = SimpleNamespace(nominal_bounds=np.array([[self.low, 2.1]]))

    @property
    def sloped(self) -> "Bent":
        return replace(self, power=3.0)

    def residuals(self, points, chosen):
        return np.array([p.z for p in points])[:, :, None, None] ** self.power


@pytest.mark.parametrize(
    ("z", "side", "end"),
    [
        (0.0, 0, ROUGH),
        (0.0, 1, -ROUGH),
        (1.0, 0, 1.0 - ROUGH),
        (-1.0, 0, -1.0 + ROUGH),
        (1.0, 1, 1.0 + ROUGH),
        (2.1, 1, 2.1 - ROUGH),  # at its bound: to the other side
        (1.0 + ROUGH * (1.1 - ROOM) + 0.01, 1, ROUGH * (1.1 - ROOM) + 0.01),  # too near to it
        (1.0 + ROUGH * (1.1 - ROOM) - 0.01, 1, 2.1),  # a narrow difference, up to it
    ],
)
def test_derivatives_of_a_floating_base_are_differences_to_one_side(z, side, end):
    (slope,) = fitting._slopes(Bent(), [plain(z)], np.arange(1), side=side)
    assert slope.item() == pytest.approx((end**3 - z**3) / (end - z))


def test_between_narrow_bounds_the_difference_is_to_the_farther_one():
    (slope,) = fitting._slopes(Bent(low=1.9), [plain(2.05)], np.arange(1))
    assert slope.item() == pytest.approx((2.05**3 - 1.9**3) / 0.15)


def test_others_take_both_sides():
    (slope,) = fitting._slopes(Bent(stands=False), [plain(1.0)], np.arange(1), side=1)
    assert slope.item() == pytest.approx((2.0**3 - 0.0) / 2.0)


@pytest.mark.parametrize(
    ("stands", "gains", "sides"),
    [(True, 0, [0, 1]), (False, 0, [0]), (True, 2, [0, 1, 0, 1]), (True, 1, [0, 1, 0]), (False, 1, [0, 1])],
)
def test_a_floating_base_goes_on_until_derivatives_to_either_side_gain_nothing(
    monkeypatch, stands, gains, sides
):
    """The iterations in `gains` (bits: first and second) gain, all others nothing."""
    asked = []

    def slopes(problem, points, chosen, leading, side):
        asked.append(side)
        return [None] * len(points)

    def steps(problem, point, *_):
        works = len(asked) <= 2 and gains >> (len(asked) - 1) & 1
        return [point.moved(0.5 * point.z) if works else point]

    problem = Bent(stands=stands)
    problem.floor = np.full(1, 1e-6)
    monkeypatch.setattr(fitting, "_slopes", slopes)
    monkeypatch.setattr(fitting, "_steps", steps)
    fit(problem, [plain(2.0)], np.arange(1), np.ones((1, 1)), iterations=9)
    assert SIDES == 2 and asked == sides


def test_rollouts_of_a_fine_standing_robot_take_a_step_half_that_of_its_derivatives():
    def step(problem: Problem) -> float:
        return problem.robot.file.robot.timestep

    standing, hanging = (
        Problem(load_robot(r), SimpleNamespace(weight=np.ones(1), spread=np.ones(1)), None)
        for r in ("quadruped", "leg")
    )
    assert standing.finer == 4
    assert step(standing) / step(standing.fine) == 4 and step(standing) / step(standing.fine.sloped) == 2
    assert standing.sloped is standing and hanging.fine.sloped is hanging.fine


def test_what_is_far_behind_does_not_go_on_to_the_end(monkeypatch):
    costs = {"": 0.0, "payload": 10.0, "gravity_tilt": 10.0 + name.AWAY, "com_offset": 11.0 + name.AWAY}
    asked = []

    def cost_of(points):
        return np.array([costs[p.hypothesis.key] for p in points])

    def fitted(problem, points, chosen, effective, *, iterations, **settings):
        asked.append(([p.hypothesis.key for p in points], len(chosen), iterations))
        return list(points), cost_of(points)

    monkeypatch.setattr(name, "fit", fitted)
    monkeypatch.setattr(name, "objective", lambda problem, points, *_: cost_of(points))
    fine = SimpleNamespace(residuals=lambda points, chosen: np.zeros((len(points), 3, 1, 1)))
    problem = SimpleNamespace(fine=fine, segments=1, effective=lambda residual: np.ones((3, 1)))
    terms = hypotheses("com_offset", "gravity_tilt", "payload")
    _, out = name._standing(problem, plain(0.0), terms, np.arange(2), np.arange(2, 3))
    near = ["payload", "gravity_tilt"]
    assert asked[:3] == [
        (["com_offset", "gravity_tilt", "payload"], 2, 1),
        ([*near, "com_offset"], 3, 1),
        (near, 3, 3),
    ]
    assert [p.hypothesis.key for p in out] == [*near, "com_offset"]


class Slipping:
    """Two windows; the term helps in the first, of which the two residuals have these samples, and 10 of the second."""

    floor = np.full(1, 1e-9)

    def __init__(self, of_plain: float, of_term: float):
        self.samples = {1.0: of_plain, 0.1: of_term}

    def effective(self, residual):
        return np.array([[self.samples[residual[0, 0, 0]]], [10.0]])


@pytest.mark.parametrize(("of_plain", "of_term"), [(4.0, 400.0), (400.0, 4.0)])
def test_a_gain_is_counted_by_the_samples_of_the_residual_that_has_fewer(of_plain, of_term):
    residuals = np.ones((2, 2, 5, 1))
    residuals[1, 0] = 0.1
    problem = Slipping(of_plain, of_term)
    gain = 0.5 * np.log(100.0)
    for order, least in ((slice(None), 4.0 * gain), (slice(None, None, -1), -400.0 * gain)):
        ordered = residuals[order]
        gains = name._by_either(problem, ordered, name.mean_squares(ordered, problem.floor))
        assert gains == pytest.approx([0.0, least], rel=1e-6)
