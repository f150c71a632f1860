"""The evolution strategy: its steps follow the function, parents die, and steps are carried over."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.screened import after
from dynreg.search.start import Start
from dynreg.search.strategy import CARRIED, STEP, EvolutionStrategy
from dynreg.search.table import SEARCHES

AT = np.array([0.3, 0.6, 0.45, 0.55])


def gone(search: EvolutionStrategy, weights: np.ndarray, generations: int) -> EvolutionStrategy:
    """The search after so many generations on a sphere about `AT`, stretched by weights."""
    for _ in range(generations):
        asked = search.ask()
        search.tell(((weights * (asked - AT)) ** 2).sum(axis=1))
    return search


def strategy(seed: int = 0, **given) -> EvolutionStrategy:
    return EvolutionStrategy(np.full(4, 0.5), rng=stream(seed, "strategy"), **given)


@pytest.mark.parametrize("seed", range(3))
def test_steps_are_small_where_a_gene_matters_much(seed: int) -> None:
    """Two genes of one hundredfold weight: in the end their steps are the smaller by far."""
    search = gone(strategy(seed, mu=9, children=50), np.array([1.0, 100.0, 1.0, 100.0]), 45)
    large, small = search.steps[[0, 2]], search.steps[[1, 3]]
    assert large.min() > 3.0 * small.max() and np.abs(search.middle - AT)[[1, 3]].max() < 0.01


def test_steps_shrink_near_the_top_and_not_on_the_way_there() -> None:
    search = strategy()
    assert np.allclose(search.steps, STEP)
    far = gone(strategy(steps=np.full(4, 0.002)), np.full(4, 1.0), 15).steps
    near = gone(search, np.full(4, 1.0), 60).steps
    assert near.max() < 0.01 * STEP and far.mean() > 2.0 * 0.002


def test_carried_steps_are_small_at_first() -> None:
    steps = np.where([True, False, True, False], CARRIED, STEP)
    away = strategy(steps=steps, children=400).ask() - 0.5
    # half of all normal draws lie within 0.674 sigma; the steps' own factors have a median of 1
    assert np.median(np.abs(away), axis=0) / 0.674 == pytest.approx(steps, rel=0.25)


@pytest.mark.parametrize("name", ["es", "cma"])
def test_a_later_search_begins_with_the_steps_of_an_earlier_one(name: str) -> None:
    kind = SEARCHES[name]
    first = kind.begin(Start(4, stream(0, name), 25))
    for _ in range(20):
        first.tell(((np.array([1.0, 30.0, 1.0, 30.0]) * (first.ask() - AT)) ** 2).sum(axis=1))
    steps = first.steps
    assert steps[[1, 3]].max() < steps[[0, 2]].min()
    later = Start(4, stream(1, name), 300, point=first.middle, steps=steps)
    screened = after(first.middle[None], kind, later)
    screened.ask()
    screened.tell(np.zeros(1))
    away = screened.ask() - first.middle
    assert np.median(np.abs(away), axis=0) / 0.674 == pytest.approx(steps, rel=0.35)


def test_a_parent_never_survives_even_if_it_is_better() -> None:
    search = strategy(mu=2, children=8)
    first = search.ask()
    search.tell(np.full(8, -100.0))
    second = search.ask()
    assert not (second[:, None] == first).all(axis=2).any()
    search.tell(np.arange(8.0))  # all of them worse than any before
    assert np.allclose(search.middle, second[:2].mean(axis=0))


def test_children_have_each_gene_of_one_of_two_parents() -> None:
    """What lies nearest to two points that are far apart is bred until steps are small; then children are mixed."""
    search = strategy(mu=2, children=400)
    points = np.array([[0.3, 0.3, 0.3, 0.3], [0.7, 0.7, 0.7, 0.7]])
    for _ in range(25):
        away = np.abs(search.ask()[:, None] - points).sum(axis=2)
        losses = away.min(axis=1)
        losses[away.argmin(axis=0)] = -1.0  # the nearest of either
        search.tell(losses)
    asked = search.ask()
    assert np.abs(asked[:, :, None] - points.T).min(axis=2).max() < 0.05, "no gene lies between"
    of_second = asked > 0.5
    assert len(np.unique(of_second, axis=0)) == 16 and np.allclose(of_second.mean(axis=0), 0.5, atol=0.1)


def test_a_loss_that_is_nan_is_the_worst() -> None:
    search = strategy(mu=2, children=4)
    asked = search.ask()
    search.tell(np.array([np.nan, 3.0, np.nan, 7.0]))
    assert np.allclose(search.middle, asked[[1, 3]].mean(axis=0))
    search.ask()
    search.tell(np.full(4, np.nan))
    assert np.isfinite(search.ask()).all()


def test_genes_that_run_round_pass_the_seam_and_others_are_thrown_back() -> None:
    turning = np.array([True, False])
    given = {"rng": stream(0, "seam"), "periodic": turning, "steps": np.array([0.05, 0.05])}
    search = EvolutionStrategy(np.array([0.97, 0.97]), **given)
    seen = search.ask()
    assert (seen[:, 0] < 0.2).any() and (seen[:, 1] > 0.6).all()
    assert (seen < 1.0).all() and len(np.unique(seen[:, 1])) == 25, "none lies on the bound"
    away = lambda x: np.minimum(np.mod(x - 0.1, 1.0), np.mod(0.1 - x, 1.0))  # noqa: E731
    search = EvolutionStrategy(np.array([0.9, 0.5]), **given)
    for _ in range(40):
        asked = search.ask()
        search.tell(away(asked[:, 0]) ** 2 + (asked[:, 1] - 0.4) ** 2)
    assert away(search.middle[0]) < 0.01 and abs(search.middle[1] - 0.4) < 0.01


def test_the_middle_of_parents_on_both_sides_of_the_seam_is_there() -> None:
    turning = np.array([True])
    search = EvolutionStrategy(
        np.array([0.0]), rng=stream(1, "seam"), periodic=turning, mu=20, children=21, steps=np.array([0.1])
    )
    asked = search.ask()
    search.tell(np.zeros(21))
    assert (asked > 0.5).any() and (asked < 0.5).any()
    assert min(search.middle[0], 1.0 - search.middle[0]) < 0.1


@pytest.mark.parametrize("wrong", [{"mu": 25}, {"mu": 1}, {"rho": 0}])
def test_sizes_that_do_not_fit_each_other_are_refused(wrong: dict) -> None:
    with pytest.raises(UsageError, match="rho"):
        strategy(**wrong)


@pytest.mark.parametrize("step", [0.05, 0.3, 0.5])
@pytest.mark.parametrize("name", ["es", "cma"])
def test_a_single_dimension_may_begin_with_any_step(name: str, step: float) -> None:
    search = SEARCHES[name].begin(Start(1, stream(0, name), 8, np.array([0.5]), steps=np.array([step])))
    for _ in range(30):
        asked = search.ask()
        search.tell((asked[:, 0] - 0.2) ** 2)
    assert search.middle[0] == pytest.approx(0.2, abs=0.02)
