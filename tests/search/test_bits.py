"""Genetic algorithms on bits: what they express, that they climb, and the operators of the operon algorithm."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.bits import BITS, LIST, BitGenetic, Operon, coded, numbers
from dynreg.search.selection import Roulette, Tournament
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES

MAKE = {"plain": BitGenetic, "operon": Operon}


def test_numbers_are_coded_by_ten_bits() -> None:
    bits = np.zeros((2, 2 * BITS), dtype=np.uint8)
    bits[1] = 1
    bits[0, 0] = bits[0, 19] = 1
    assert numbers(bits) == pytest.approx(np.array([[512 / 1023, 1 / 1023], [1.0, 1.0]]))


@pytest.mark.parametrize("digits", [1, 8, BITS])
def test_what_is_coded_comes_back_as_the_nearest_number(digits: int) -> None:
    points = stream(0, "points").uniform(size=(200, 3))
    back = numbers(coded(points, digits), digits)
    assert coded(points, digits).shape == (200, 3 * digits)
    assert np.abs(back - points).max() <= 0.5 / (2**digits - 1) + 1e-12
    assert np.array_equal(numbers(coded(back, digits), digits), back)


@pytest.mark.parametrize("name", MAKE)
def test_both_climb_and_do_the_same_again(name: str) -> None:
    def losses(x: np.ndarray) -> np.ndarray:
        return ((x - 0.3) ** 2).sum(axis=1)

    ends = []
    for _ in range(2):
        search = MAKE[name](8, rng=stream(1, name), mutation=0.02)
        first = losses(search.ask()).min()
        search.tell(losses(search._asked))
        for _ in range(60):
            asked = search.ask()
            assert asked.shape == (50, 8) and (asked >= 0).all() and (asked <= 1).all()
            search.tell(losses(asked))
        ends.append(losses(search.ask()).min())
    assert ends[0] == ends[1] < 0.25 * first and not search.stopped and search.middle is None


@pytest.mark.parametrize("name", MAKE)
def test_the_elite_goes_on_as_it_is_and_nan_is_the_worst(name: str) -> None:
    search = MAKE[name](3, rng=stream(2, name), population=8, selection=Tournament(2), elite=2, mutation=0.5)
    asked = search.ask()
    losses = np.array([5.0, np.nan, 1.0, 4.0, np.nan, 0.5, 3.0, 2.0])
    search.tell(losses)
    assert np.array_equal(search.ask()[:2], asked[[5, 2]])
    with pytest.raises(UsageError, match="elite 8"):
        MAKE[name](3, rng=stream(2, name), population=8, elite=8)


@pytest.mark.parametrize("name", MAKE)
def test_a_first_generation_has_what_it_is_seeded_with(name: str) -> None:
    points = stream(4, "points").uniform(size=(3, 2))
    given = {"rng": stream(4, name), "population": 6, "digits": 8}
    search = MAKE[name](2, seeds=points, **given)
    asked = search.ask()
    assert np.abs(asked[:3] - points).max() <= 0.5 / 255 and len(np.unique(asked[3:], axis=0)) == 3
    search.tell(np.array([1.0, 0.0, 1.0, 1.0, 1.0, 1.0]))
    assert np.array_equal(search.ask()[0], asked[1]), "a seed breeds, and the elite of one is the second"
    with pytest.raises(UsageError, match="7 seeds"):
        MAKE[name](2, seeds=np.zeros((7, 2)), **given)


@pytest.mark.parametrize("name", ["bits", "operon", "roulette"])
def test_where_a_search_sets_out_is_one_of_its_first_generation(name: str) -> None:
    point = np.array([0.123, 0.9, 0.456])
    first = SEARCHES[name].begin(Start(3, stream(6, name), 10, point)).ask()
    assert np.abs(first[0] - point).max() <= 0.5 / 255 < np.abs(first[1:] - point).max(axis=1).min()


def test_children_of_a_roulette_without_changes_are_copies_and_the_elite_may_die() -> None:
    """Without mutation and with one bit a number that all share, nothing is left to cross."""
    rng = stream(5, "copies")
    search = BitGenetic(4, rng=rng, population=40, selection=Roulette(), elite=0, mutation=0.0, digits=1)
    ends = set()
    for _ in range(60):
        asked = search.ask()
        ends.add(float(asked.sum(axis=1).max()))
        search.tell(-asked.sum(axis=1))
    assert ends == {4.0} and (search.ask() == 1.0).all()
    alone = BitGenetic(4, rng=rng, population=40, selection=Roulette(), elite=0, mutation=0.5, digits=8)
    best = alone.ask()[7].copy()
    alone.tell(np.where(np.arange(40) == 7, 0.0, 1.0))
    assert not (alone.ask() == best).all(axis=1).any()


def operons(search: Operon, child: int = 0) -> list[int]:
    """Lengths of the operons."""
    return np.diff(np.concatenate([[-1], np.flatnonzero(search._ends[child])])).tolist()


@pytest.fixture
def search() -> Operon:
    return Operon(2, rng=stream(3, "operon"), population=2, elite=0)


def test_operons_join_and_part(search: Operon) -> None:
    assert operons(search) == [1] * 20
    for _ in range(19):
        search._connect(0)
    assert operons(search) == [20] and operons(search, 1) == [1] * 20
    search._connect(0)  # nothing left to join
    assert operons(search) == [20] and np.array_equal(search._operon(0), np.arange(20))
    search._divide(0)
    assert len(operons(search)) == 2 and sum(operons(search)) == 20
    search._divide(1)  # nothing to part
    assert operons(search, 1) == [1] * 20


def test_what_is_duplicated_can_change_unseen_and_be_turned_out(search: Operon) -> None:
    for _ in range(19):
        search._connect(0)
    before = search.bits[0].copy()
    search._duplicate(0)
    assert np.array_equal(search.bits[0], before) and (search._length[0] == 2).all()
    assert np.array_equal(search._values[0, :, 1], before)
    search._values[0, 4, 1] ^= 1  # a mutation that nobody sees
    assert np.array_equal(search.bits[0], before)
    search._invert(0)
    changed = np.flatnonzero(search.bits[0] != before)
    assert changed.tolist() == [4] and search._values[0, 4, 1] == before[4]
    for _ in range(10):
        search._duplicate(0)
    assert (search._length[0] == LIST).all()
    for _ in range(10):
        search._delete(0)
    assert (search._length[0] == 1).all() and not search._values[0, :, 1:].any()
    assert (search._length[1] == 1).all()


def test_inversion_turns_lists_of_any_length(search: Operon) -> None:
    search._ends[0, :-1] = False
    search._values[0, 0, :3], search._length[0, 0] = [1, 0, 0], 3
    search._values[0, 1, :2], search._length[0, 1] = [0, 1], 2
    search._values[0, 2, 0] = 1
    search._invert(0)
    assert search._values[0, 0].tolist() == [0, 0, 1, 0, 0, 0]
    assert search._values[0, 1].tolist() == [1, 0, 0, 0, 0, 0]
    assert search._values[0, 2].tolist() == [1, 0, 0, 0, 0, 0]
