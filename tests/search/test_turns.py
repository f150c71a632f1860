"""What ask-and-tell searches share."""

import numpy as np

from dynreg.rng import stream
from dynreg.search.turns import ranked


def test_the_best_come_first_and_numbers_that_are_none_last() -> None:
    order, places = ranked(np.array([2.0, np.nan, -1.0, 0.5]), stream(1, "ranked"))
    assert order.tolist() == [2, 3, 0, 1] and places.tolist() == [2, 3, 0, 1]


def test_on_flat_ground_every_candidate_may_come_first() -> None:
    rng = stream(1, "ranked")
    first = [int(ranked(np.array([0.0, 0.0, 1.0, 0.0]), rng)[0][0]) for _ in range(300)]
    counts = np.bincount(first, minlength=4)
    assert counts[2] == 0 and (counts[[0, 1, 3]] > 60).all()
