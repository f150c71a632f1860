"""Cells of wheel speeds, and pieces of commands in them."""

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.timed.cells import Grid, mean_by_cell, pieces
from dynreg.timed.commands import Commands

GRID = Grid(-0.2, 0.2, 4)


def test_a_cell_is_found_from_its_middle_and_its_edges_belong_to_one() -> None:
    cells = np.arange(GRID.cells)
    assert (GRID.cell(*GRID.middle(cells).T) == cells).all()
    assert GRID.middle(np.array([1])).ravel() == pytest.approx([-0.15, -0.05])
    at = np.array([-0.2, 0.2, 0.2001, -0.2001])
    assert GRID.cell(at, np.zeros(4)).tolist() == [2, 14, -1, -1]
    assert (GRID.cell(np.array([np.nan]), np.zeros(1)) == -1).all()


@pytest.mark.parametrize("grid", [(0.0, 0.0, 4), (0.2, -0.2, 4), (-0.2, np.inf, 4), (-0.2, 0.2, 0)])
def test_a_grid_without_cells_is_refused(grid: tuple[float, float, int]) -> None:
    with pytest.raises(UsageError, match="one cell or more between two speeds"):
        Grid(*grid)


def test_pieces_of_a_drive_are_one_sample_and_others_are_left_out() -> None:
    """A drive of two pieces and its short end; one too long; one too fast; the same speeds in another episode."""
    left = np.array([0.1, 0.1, 0.1, -0.1, 0.3, 0.15, 0.15])
    before = np.array([0.0, 0.1, 0.1, 0.1, -0.1, 0.3, 0.0])
    seconds = np.array([0.5, 0.5, 0.1, 0.7, 0.5, 0.5, 0.5])
    told = Commands(left, np.zeros(7), seconds, before, np.zeros(7))
    moved = np.arange(21.0).reshape(7, 3)
    found = pieces(told, moved, np.array([0, 0, 0, 0, 0, 0, 1]), GRID, 0.5, told)
    assert (found.short, found.long, found.outside) == (1, 1, 1)
    assert found.drive.tolist() == [0, 0, 1, 2] and found.episode.tolist() == [0, 0, 1]
    assert np.allclose(found.by_drive(found.moved), [(moved[0] + moved[1]) / 2, moved[5], moved[6]])
    table = found.table(GRID, found.moved)
    assert table.cell.tolist() == [14, 14, 14] and table.born.tolist() == [0, 0, 0]
    means = mean_by_cell(GRID.cells, table.cell, table.values)
    assert np.allclose(means[14], table.values.mean(axis=0)) and np.isnan(np.delete(means, 14, axis=0)).all()


def test_the_same_speeds_again_after_others_are_another_sample() -> None:
    """Others in between were left out of the log for want of a pose; so was a piece of the second drive."""
    speeds = np.array([0.1, 0.1, 0.1, 0.1])
    still, half = np.zeros(4), np.full(4, 0.5)
    for left_before, right_before in (([0.0, 0.1, -0.1, 0.1], still), ([0.0, 0.1, 0.1, 0.1], [0, 0, 0.1, 0])):
        told = Commands(speeds, still, half, np.array(left_before), np.array(right_before, dtype=float))
        found = pieces(told, np.zeros((4, 3)), np.zeros(4, dtype=int), GRID, 0.5, told)
        assert found.drive.tolist() == [0, 0, 1, 1]
