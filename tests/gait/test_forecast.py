"""Which gait a robot shall try next: one near that walked, or a new one."""

import numpy as np
import pytest

from dynreg.gait.forecast import new_does_more
from dynreg.gait.near import DOUBT
from dynreg.gait.seek import COMPARED, EXPECTED, UNSEEN

FELL = -999.0
WALKED = [2.0] * 40
FALLS = [FELL] * 2  # a twentieth of forty runs
# {case: (runs of the gait that walked, of one near it, of a new one; what the first reached there; the new one?)}
CASES = {
    "what is near gains on what the robot reached": (WALKED, [3.0] * 40, [4.9] * 40, 4.0, False),
    "it gains less than the new one": (WALKED, [3.0] * 40, [5.1] * 40, 4.0, True),
    "it loses": (WALKED, [1.0] * 40, [3.1] * 40, 4.0, True),
    "the robot reached what the simulators say": (WALKED, [3.0] * 40, [3.1] * 40, 2.0, True),
    "the mean counts, not the worst": (WALKED, [3.0] * 40, [1.0] * 20 + [6.0] * 20, 2.0, True),
    "a fall is no gain": (WALKED, [3.0] * 40, [*FALLS, *[3.1] * 38], 2.0, False),
    "the new one falls no more than a twentieth more often": (
        WALKED,
        WALKED,
        [*FALLS, *[9.0] * 38],
        2.0,
        True,
    ),
    "it falls more often": (WALKED, WALKED, [FELL, *FALLS, *[9.0] * 37], 2.0, False),
    "so does the gait that walked": ([FELL, *[2.0] * 39], WALKED, [FELL, *FALLS, *[9.0] * 37], 2.0, True),
    "so does what is near": (WALKED, [FELL, *[2.0] * 39], [FELL, *FALLS, *[9.0] * 37], 2.0, True),
    "what is near falls, and is worth more": (WALKED, [*FALLS * 3, *[9.0] * 34], [4.0] * 40, 2.0, False),
}


@pytest.fixture
def gaits(trials) -> np.ndarray:
    """(4, G): one that walked, another that the robot has had, one near the first, a new one."""
    space = trials.space
    return space.feasible(space.from_unit(np.random.default_rng(3).uniform(size=(4, len(space)))))


@pytest.mark.parametrize("case", CASES)
def test_that_one_is_tried_which_should_do_more_on_the_robot(case: str, trials, gaits, monkeypatch) -> None:
    *runs, reached, new = CASES[case]
    asked = []

    def again(genes: np.ndarray, draws: int, *, first: int, doubt: float) -> np.ndarray:
        asked.append((genes, draws, first, doubt))
        return np.array(runs).reshape(3, draws, 2)

    monkeypatch.setattr(trials, "again", again)
    walked, other, near, found = gaits
    assert new_does_more(trials, np.array([walked, other]), reached, near, found) is new
    ((genes, draws, first, doubt),) = asked  # the same draws for all, which no search has seen
    assert np.array_equal(genes, [walked, near, found]) and (2 * draws, doubt) == (EXPECTED, DOUBT)
    assert first == COMPARED >= UNSEEN + EXPECTED


def test_a_gait_that_the_robot_has_had_is_not_new(trials, gaits, monkeypatch) -> None:
    monkeypatch.setattr(
        trials, "again", lambda genes, draws, **_: np.ones((3, draws, 2)) * [[[1.0]], [[1.0]], [[9.0]]]
    )
    walked, other, near, found = gaits
    had = np.array([walked, other])
    assert new_does_more(trials, had, 1.0, near, found)
    assert not any(new_does_more(trials, had, 1.0, near, one) for one in had)
