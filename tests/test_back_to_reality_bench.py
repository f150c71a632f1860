"""The bench of Back to Reality recomputes the table of the paper, whose column IF is printed as a fraction."""

import pytest
from bench_back_to_reality import TABLE, improvement, learning
from reality_runs import scaled


@pytest.mark.parametrize("name", TABLE)
def test_learning_performance_comes_out_to_the_third_digit(name: str) -> None:
    genes, trials, first, last, fraction, printed, recomputed = TABLE[name]
    assert improvement(first, last) / 100.0 == pytest.approx(fraction, abs=1e-3), "a fraction is printed"
    assert round(learning(genes, trials, first, last), 3) == recomputed
    assert recomputed == pytest.approx(printed, abs=0.006)
    as_printed = genes * fraction / trials
    assert as_printed == pytest.approx(printed / 100.0, rel=0.01), "with the fraction LP would be a hundredth"


def test_a_share_of_the_generations_leaves_trials_as_published() -> None:
    part, usual = scaled(0.1, 2), scaled(1.0, 2)
    assert (part.first, part.later, part.turns) == (60, 10, 4)
    assert (part.stand, part.repeats, part.variations * part.steps) == (10, 3, 130)
    assert (usual.first, usual.later, usual.turns) == (600, 100, 45)
