"""A gait for each of many goals: corners come back, what is linear is met exactly, and gaps are filled from beside."""

from itertools import product

import numpy as np
import pytest

from dynreg.adapt.goals import Goals, neighbours
from dynreg.errors import NoMatchError, UsageError
from dynreg.rng import stream

AXES = (np.array([0.14, 0.18]), np.array([0.0, 0.8, 1.6]), np.linspace(0.0, 3.0, 5))
SHAPE = (2, 3, 5)


def drawn() -> np.ndarray:
    return stream(1, "gaits").uniform(size=(*SHAPE, 4))


def test_every_point_of_the_grid_has_its_own_gait() -> None:
    goals = Goals(AXES, drawn())
    for at in np.ndindex(*SHAPE):
        goal = [axis[i] for axis, i in zip(AXES, at, strict=True)]
        assert np.array_equal(goals.at(goal), goals.gaits[at])


def test_a_gait_that_is_linear_in_each_coordinate_is_met_everywhere() -> None:
    """Also the products of coordinates: the interpolation is trilinear."""
    law = lambda a, b, c: np.array([a, b - c, a * b * c, 1.0])  # noqa: E731
    gaits = np.array([law(*goal) for goal in product(*AXES)]).reshape(*SHAPE, 4)
    rng = stream(2, "goals")
    for _ in range(20):
        goal = [rng.uniform(axis[0], axis[-1]) for axis in AXES]
        assert Goals(AXES, gaits).at(goal) == pytest.approx(law(*goal))


def test_between_points_it_lies_between_their_gaits() -> None:
    goals = Goals(AXES, drawn())
    middle = goals.at([0.14, 0.4, 0.0])
    assert middle == pytest.approx((goals.gaits[0, 0, 0] + goals.gaits[0, 1, 0]) / 2)


def test_gaps_are_filled_from_beside_and_what_is_solved_stays() -> None:
    gaits = drawn()
    gaits[0, 0, :2] = gaits[1, 2, 4] = np.nan
    goals = Goals(AXES, gaits)
    assert goals.solved.sum() == 27
    filled = goals.filled()
    assert filled.solved.all() and np.array_equal(filled.gaits[goals.solved], gaits[goals.solved])
    assert filled.gaits[1, 2, 4] == pytest.approx((gaits[0, 2, 4] + gaits[1, 1, 4] + gaits[1, 2, 3]) / 3)
    assert filled.gaits[0, 0, 0] == pytest.approx((gaits[1, 0, 0] + gaits[0, 1, 0]) / 2)


def test_one_solved_point_fills_the_whole_grid_and_none_is_an_error() -> None:
    gaits = np.full((*SHAPE, 4), np.nan)
    with pytest.raises(NoMatchError, match="no goal is solved"):
        Goals(AXES, gaits).filled()
    gaits[1, 1, 2] = [0.1, 0.2, 0.3, 0.4]
    assert Goals(AXES, gaits).filled().gaits == pytest.approx(np.broadcast_to(gaits[1, 1, 2], gaits.shape))


def test_what_is_unsolved_is_used_only_where_it_has_no_weight() -> None:
    gaits = drawn()
    gaits[1] = np.nan
    goals = Goals(AXES, gaits)
    assert np.isfinite(goals.at([0.14, 0.3, 1.1])).all() and np.isnan(goals.at([0.15, 0.3, 1.1])).all()


def test_neighbours_are_one_step_along_one_axis_and_mutual() -> None:
    assert sorted(neighbours(SHAPE, (0, 1, 0))) == [(0, 0, 0), (0, 1, 1), (0, 2, 0), (1, 1, 0)]
    every = list(np.ndindex(*SHAPE))
    assert all((a in neighbours(SHAPE, b)) == (b in neighbours(SHAPE, a)) for a in every for b in every)


@pytest.mark.parametrize("goal", [[0.13, 0.0, 0.0], [0.14, 1.7, 0.0], [0.14, 0.0, float("nan")]])
def test_goals_outside_the_grid_are_refused(goal: list[float]) -> None:
    with pytest.raises(UsageError, match="outside the grid"):
        Goals(AXES, drawn()).at(goal)


@pytest.mark.parametrize("axes", [AXES[:2], (AXES[0][::-1], *AXES[1:]), (AXES[0][:1], *AXES[1:])])
def test_a_grid_that_does_not_fit_is_refused(axes: tuple) -> None:
    with pytest.raises(UsageError, match="two or more rising values"):
        Goals(axes, drawn())
