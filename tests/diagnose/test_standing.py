"""A floating base on its feet: where its terms start, how its derivatives are taken, and what they gain."""

from collections import Counter
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from dynreg.diagnose import fit as fitting
from dynreg.diagnose.effort import Effort
from dynreg.diagnose.finish import AWAY, standing
from dynreg.diagnose.fit import ROOM, ROUGH, SIDES, fit
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.diagnose.problem import Point, Problem, mean_squares
from dynreg.diagnose.score import by_either
from dynreg.diagnose.shortlist import CLEAR, best_of_each, clear, in_turn
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot


def plain(*z: float) -> Point:
    return Point(Hypothesis(), np.array(z), np.zeros(0))


def hypotheses(*keys: str) -> list[Point]:
    return [Point(Hypothesis((term(key),)), np.zeros(1), np.ones(1)) for key in keys]


def started(*found: tuple[float, str]) -> list[tuple[float, Point]]:
    """Objectives [nats] and points of terms that were begun from one start."""
    return [(cost, *hypotheses(key)) for cost, key in found]


AHEAD = started((950.0, "gravity_tilt"), (900.0, "payload"))  # from the nameplate
NEAR = started(
    (999.0, "ground_friction"), (960.0, "payload"), (940.0, "com_offset")
)  # from the calibrated model


def keys(points: list[Point]) -> list[str]:
    return [point.hypothesis.key for point in points]


def test_terms_of_a_floating_base_come_in_turn_from_the_nameplate_and_from_the_calibrated_model():
    listed = in_turn(AHEAD, NEAR, without=1000.0)
    assert keys(listed) == ["payload", "com_offset", "gravity_tilt"]  # 999 is no gain on 1000
    assert listed[0] is AHEAD[1][1], "each term once, where it comes first"


def test_terms_of_other_rough_robots_are_sorted_together():
    assert keys(best_of_each([*NEAR, *AHEAD])) == ["payload", "com_offset", "gravity_tilt", "ground_friction"]


def test_what_is_clear_from_the_nameplate_is_not_sought_from_the_calibrated_model_too():
    assert clear(AHEAD, 900.0 + CLEAR + 1.0) and not clear(AHEAD, 900.0 + CLEAR - 1.0)
    assert keys(in_turn(AHEAD, [], without=1201.0)) == ["payload", "gravity_tilt"]


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


@dataclass
class Deaf(Bent):
    """Steps gain in the iterations of which `gains` has a bit, and nothing in others; `sides` of each derivative."""

    gains: int = 0
    sides: list[int] = field(default_factory=list)
    floor: np.ndarray = field(default_factory=lambda: np.full(1, 1e-6))

    @property
    def sloped(self) -> "Deaf":
        return replace(self, power=0.0)

    def residuals(self, points, chosen):
        if not self.power:  # derivatives: from the point to its ends
            here, end = (points[i].z[0] for i in (0, 1))
            self.sides.append(int((here > 0) == (end > here)))
        gained = sum(self.gains >> i & 1 for i in range(len(self.sides)))
        return np.full((len(points), 1, 1, 1), 0.5**gained)


@pytest.mark.parametrize(
    ("stands", "gains", "iterations"),
    [(True, 0, 2), (False, 0, 1), (True, 0b11, 4), (True, 0b01, 3), (False, 0b01, 2)],
)
def test_a_floating_base_goes_on_until_derivatives_to_either_side_gain_nothing(stands, gains, iterations):
    problem = Deaf(stands=stands, gains=gains)
    fit(problem, [plain(0.0)], np.arange(1), np.full((1, 1), 40.0), iterations=9)
    assert len(problem.sides) == iterations
    if stands:
        assert problem.sides == [number % SIDES for number in range(iterations)] and SIDES == 2


def test_rollouts_of_a_fine_standing_robot_take_a_step_half_that_of_its_derivatives():
    def step(problem: Problem) -> float:
        return problem.robot.file.robot.timestep

    upright, hanging = (
        Problem(load_robot(r), SimpleNamespace(weight=np.ones(1), spread=np.ones(1)), None)
        for r in ("quadruped", "leg")
    )
    assert upright.finer == 4
    assert step(upright) / step(upright.fine) == 4 and step(upright) / step(upright.fine.sloped) == 2
    assert upright.sloped is upright and hanging.fine.sloped is hanging.fine


class Settled:
    """Three windows, whose likelihood is that of each hypothesis, whatever its coordinates; runs are counted by it."""

    stands, segments, floor, rough = True, 1, np.full(1, 1e-12), True
    SAMPLES = 200.0

    def __init__(self, costs: dict[str, float]):
        self.costs, self.runs = costs, Counter()
        self.coordinates = SimpleNamespace(nominal_bounds=np.array([[-9.0, 9.0]]))
        self.fine = self.sloped = self

    def residuals(self, points, chosen):
        self.runs.update(p.hypothesis.key for p in points if len(chosen) == 3)
        sizes = [np.exp(self.costs[p.hypothesis.key] / (3 * self.SAMPLES)) for p in points]
        return np.ones((len(points), len(chosen), 5, 1)) * np.array(sizes)[:, None, None, None]

    def effective(self, residual):
        return np.full((len(residual), 1), self.SAMPLES)


def test_what_is_far_behind_does_not_go_on_to_the_end():
    costs = {"": 0.0, "payload": 10.0, "gravity_tilt": 10.0 + AWAY - 1.0, "com_offset": 11.0 + AWAY}
    problem, terms = Settled(costs), hypotheses("com_offset", "gravity_tilt", "payload")
    _, out = standing(problem, plain(0.0), terms, np.arange(2), np.arange(2, 3), Effort())
    assert keys(out) == ["payload", "gravity_tilt", "com_offset"]
    assert problem.runs["com_offset"] < problem.runs["gravity_tilt"] <= problem.runs["payload"]


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
        gains = by_either(problem, ordered, mean_squares(ordered, problem.floor))
        assert gains == pytest.approx([0.0, least], rel=1e-6)
