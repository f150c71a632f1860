"""Tests of shifts cell by cell, what explains them, and how often they err."""

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.cells import Grid, Pieces
from dynreg.timed.commands import Commands
from dynreg.timed.drift import (
    CLEAR,
    Judged,
    apart_at,
    explained,
    rivals,
    shifts,
    split_against_itself,
)
from dynreg.timed.reference import Reference
from dynreg.timed.table import DisplacementTable, Rules
from dynreg.timed.unicycle import KHEPERA

GRID = Grid(-0.2, 0.2, 6)
REFERENCE = Reference(KHEPERA, 0.0884)
NOISE = np.array([0.001, 0.001, 0.01])  # m, m, rad


def driven(seed: int, each: int = 6, truth: Reference = REFERENCE) -> Pieces:
    """Pieces of half a second, `each` in every cell, in ten episodes."""
    rng = stream(seed, "driven")
    cell = np.repeat(np.arange(GRID.cells), each)
    left, right = (GRID.middle(cell) + rng.uniform(-0.03, 0.03, (len(cell), 2))).T
    commands = Commands(left, right, np.full(len(cell), 0.5), left, right)
    moved = truth.predict(commands) + NOISE * rng.standard_normal((len(cell), 3))
    return Pieces(commands, moved, cell, np.arange(len(cell)), rng.integers(0, 10, len(cell)), 0, 0, 0)


def off(of: Pieces) -> np.ndarray:
    return of.moved - REFERENCE.predict(of.commands)


def judged(**evidence: float) -> tuple[Judged, ...]:
    order = sorted(evidence.items(), key=lambda item: -item[1])
    return tuple(Judged(name.replace("_", " "), 0.9, 0.8, 1.0, 0.5, e) for name, e in order)


@pytest.mark.parametrize("welch", [False, True])
def test_a_shift_is_its_t_times_its_standard_error(welch: bool) -> None:
    from scipy.stats import norm, ttest_ind

    old, new = (driven(seed, each).table(GRID, off(driven(seed, each))) for seed, each in ((1, 6), (2, 4)))
    found = shifts(old, new, Rules(welch=welch))
    one = ttest_ind(new.values[new.cell == 9], old.values[old.cell == 9], equal_var=not welch)
    assert found.value[9] / found.error[9] == pytest.approx(one.statistic)
    assert found.p[9] == pytest.approx(one.pvalue)
    assert np.abs(found.sigmas[9]) == pytest.approx(norm.isf(one.pvalue / 2))
    assert (np.sign(found.sigmas[9]) == np.sign(found.value[9])).all()
    assert (found.count[:, 9] == [6, 4]).all()
    assert np.nanmean(found.pooled, axis=0) == pytest.approx(NOISE * np.sqrt(1 / 6 + 1 / 4), rel=0.2)


def test_cells_without_two_samples_are_no_test() -> None:
    old = DisplacementTable.of(3, np.array([0, 0, 1, 2, 2]), stream(1, "few").standard_normal((5, 3)))
    new = DisplacementTable.of(3, np.array([0, 1, 1, 2, 2]), stream(2, "few").standard_normal((5, 3)))
    found = shifts(old, new, Rules(together=True))
    for values in (found.p, found.value, found.error, found.pooled):
        assert np.isfinite(values).all(axis=1).tolist() == [False, False, True]


def test_a_pattern_is_named_only_above_no_change_and_its_rivals() -> None:
    assert rivals(()) == ()
    assert rivals(judged(no_change=0.0, left_wheel=CLEAR - 1)) == ()
    assert rivals(judged(no_change=0.0, left_wheel=CLEAR + 1)) == ("left wheel",)
    assert rivals(judged(no_change=0.0, left_wheel=50.0, all_speeds=50 - CLEAR - 1)) == ("left wheel",)
    near = judged(no_change=0.0, left_wheel=CLEAR + 1, turns_only=CLEAR - 1, right_wheel=-5.0)
    assert rivals(near) == ("left wheel", "turns only")


def test_what_scatter_does_not_explain_widens_the_intervals() -> None:
    """The same factor, once beside a shift of every second cell that no pattern brings."""
    old, new = driven(1), driven(2, truth=REFERENCE.changed("all speeds", 0.9))
    change = lambda name, factor: _change(new, name, factor)  # noqa: E731
    found = {}
    for extra in (0.0, 0.01):
        more = off(new) + extra * (new.cell[:, None] % 2)
        order = explained(shifts(old.table(GRID, off(old)), new.table(GRID, more), Rules()), change)
        found[extra] = order[0]
        assert order[0].name == "all speeds" and order[0].low < 0.9 < order[0].high
    assert found[0.01].high - found[0.01].low > 2 * (found[0.0].high - found[0.0].low)
    assert found[0.01].evidence < 0.3 * found[0.0].evidence


def _change(new: Pieces, name: str, factor: float) -> np.ndarray:
    from dynreg.timed.drift import change_by_cell

    return change_by_cell(REFERENCE, new, GRID)(name, factor)


def test_split_against_itself_the_test_keeps_its_level() -> None:
    """Mean over twelve recordings: 5 % of tests one by one, and alarms about as often as the level says."""
    rates = []
    for seed in range(12):
        old = driven(seed)
        split = split_against_itself(
            old, off(old), GRID, REFERENCE, Rules(together=True), 30, stream(seed, "splits")
        )
        assert split.by == "episodes" and split.splits == 30 and split.tests > 50
        rates.append((split.one_by_one, split.alarms))
    one_by_one, alarms = np.mean(rates, axis=0)
    assert 0.04 < one_by_one < 0.06 and alarms < 0.12


def test_a_change_within_the_earlier_recording_is_seen_by_its_splits() -> None:
    """Half of its episodes with the left wheel slower: splits by whole episodes differ more than the level says."""
    old, other = driven(3, each=8), driven(3, each=8, truth=REFERENCE.changed("left wheel", 0.7))
    moved = np.where((old.episode < 5)[old.drive, None], old.moved, other.moved)
    mixed = Pieces(old.commands, moved, old.cell, old.drive, old.episode, 0, 0, 0)
    split = split_against_itself(
        mixed, off(mixed), GRID, REFERENCE, Rules(together=True), 30, stream(3, "splits")
    )
    assert split.alarms > 0.5


def test_few_episodes_are_split_by_commands_and_nothing_is_not_split() -> None:
    old = driven(1)
    one = Pieces(old.commands, old.moved, old.cell, old.drive, np.zeros(old.drives, dtype=int), 0, 0, 0)
    assert split_against_itself(one, off(one), GRID, REFERENCE, Rules(), 3, stream(1, "x")).by == "commands"
    tiny = driven(1, each=1)
    assert split_against_itself(tiny, off(tiny), GRID, REFERENCE, Rules(), 3, stream(1, "x")) is None


@pytest.mark.parametrize(
    "pair, straight", [(("left wheel", "turns only"), False), (("all speeds", "turns only"), True)]
)
def test_commands_that_tell_two_patterns_apart(pair: tuple[str, str], straight: bool) -> None:
    """All speeds and turns differ where it drives straight ahead."""
    old = driven(1)
    found = shifts(old.table(GRID, off(old)), old.table(GRID, off(old)), Rules())
    order = tuple(Judged(name, 0.85, 0.8, 0.9, 0.5, 20.0) for name in pair)
    told = apart_at(found, order, REFERENCE, GRID, 0.5)
    assert 1 <= len(told) <= 4 and all(known for *_, known in told)
    assert [t[2] for t in told] == sorted((t[2] for t in told), reverse=True) and told[-1][2] >= 3.0
    if straight:
        assert told[0][0] == pytest.approx(told[0][1])
