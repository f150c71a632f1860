"""The genetic algorithm: what its operators do to genes, and that it finds what it looks for."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.drive import Limits, drive
from dynreg.search.genetic import Genetic, Rules


def bred(losses: np.ndarray | None = None, **settings) -> tuple[np.ndarray, np.ndarray]:
    """A first generation, and the next one; by default the first gene is the loss."""
    search = Genetic(3, rng=stream(0, "genes"), rules=Rules(**settings))
    first = search.ask()
    search.tell(first[:, 0] if losses is None else losses)
    return first, search.ask()


def test_without_crossing_and_mutation_the_next_generation_is_of_winners():
    first, second = bred(population=200, tournament=40, crossover=0.0, mutation=0.0)
    rank = {tuple(genes): i for i, genes in enumerate(first[np.argsort(first[:, 0])])}
    ranks = np.array([rank[tuple(genes)] for genes in second])
    # the best of 40 draws is among the best tenth but for a chance of 0.9^40 = 1.5 %
    assert np.mean(ranks >= 20) < 0.05 and 2.0 < ranks.mean() < 7.0


def test_a_tournament_of_one_chooses_nothing():
    first, second = bred(population=2000, tournament=1, crossover=0.0, mutation=0.0)
    assert second[:, 0].mean() == pytest.approx(first[:, 0].mean(), abs=0.04)


def test_children_of_a_crossing_have_the_mean_of_their_parents_and_keep_their_spread_on_average():
    """The median of beta is 1; half of the children lie between their parents, half outside."""
    search = Genetic(1, rng=stream(0, "pairs"), rules=Rules(20000, crossover=1.0))
    parents = np.tile([[0.45], [0.55]], (10000, 1))
    children = search._crossed(parents)
    assert np.allclose(children[::2] + children[1::2], 1.0)
    apart = np.abs(children[::2] - 0.5) / 0.05
    assert np.mean(apart < 1.0) == pytest.approx(0.5, abs=0.02)
    # P(beta < b) = b^(eta + 1) / 2 for b <= 1, P(beta > b) = b^-(eta + 1) / 2 beyond
    assert np.mean(apart < 0.8) == pytest.approx(0.5 * 0.8**6, abs=0.01)
    assert np.mean(apart > 1.25) == pytest.approx(0.5 * 1.25**-6, abs=0.01)


def test_a_share_of_the_pairs_is_crossed():
    search = Genetic(4, rng=stream(0, "share"), rules=Rules(4000, crossover=0.8))
    parents = stream(0, "parents").uniform(0.4, 0.6, (4000, 4))
    same = (search._crossed(parents) == parents).all(axis=1)
    assert np.mean(same) == pytest.approx(0.2, abs=0.03) and (same[::2] == same[1::2]).all()


def test_mutations_move_a_share_of_the_genes_within_their_width_or_draw_them_anew():
    search = Genetic(2, rng=stream(0, "moves"), rules=Rules(20000, width=np.array([0.1, 1.0])))
    genes = np.full((20000, 2), 0.5)
    moved = search._mutated(genes)
    assert np.allclose((moved != genes).mean(axis=0), 0.05, atol=0.006)
    near, anew = (moved[moved[:, i] != 0.5, i] for i in (0, 1))
    assert 0.09 < np.abs(near - 0.5).max() <= 0.1 and 0.0 < anew.min() < 0.01 and 0.99 < anew.max() < 1.0


def test_the_elite_goes_on_as_it_is_and_what_has_no_loss_does_not():
    losses = np.arange(20.0)
    losses[0] = np.nan
    first, second = bred(losses, population=20, elite=2, mutation=1.0)
    assert np.array_equal(second[:2], first[1:3])
    _, second = bred(losses, population=20, tournament=200, crossover=0.0, mutation=0.0)
    assert (second == first[1]).all()  # with a tournament that all take part in, the best alone


def test_it_finds_the_top_of_a_crooked_valley():
    def grades(x):
        a, b = 4.0 * x[:, 0] - 2.0, 4.0 * x[:, 1] - 1.0
        return -((1.0 - a) ** 2 + 100.0 * (b - a**2) ** 2)[:, None]  # Rosenbrock, at (1, 1)

    search = Genetic(2, rng=stream(0, "valley"), rules=Rules(100, tournament=5, elite=1))
    found = drive(search, grades, lambda g: (g[:, 0], -g[:, 0]), Limits(20000))
    assert found.value > -0.01 and found.evaluations == 20000


@pytest.mark.parametrize("wrong", [{"population": 3}, {"tournament": 0}, {"population": 4, "elite": 4}])
def test_generations_that_cannot_be_are_refused(wrong):
    with pytest.raises(UsageError, match="population"):
        Rules(**wrong)
