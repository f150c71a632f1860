"""The displacement table predicts: what a cell's commands did beyond the closed form, they do again."""

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.cells import Grid
from dynreg.timed.cellwise import Cellwise, fit_cellwise
from dynreg.timed.commands import Commands, drawn
from dynreg.timed.kinematic import kinematic
from dynreg.timed.unicycle import KHEPERA, unicycle

TRACK = 0.0884
NOISE = np.array([0.001, 0.001, 0.01])


def error(model, commands: Commands, moved: np.ndarray) -> np.ndarray:
    """(3,) mean absolute errors."""
    return np.abs(model.predict(commands) - moved).mean(axis=0)


def halves(truth, many: int = 1460) -> list[tuple[Commands, np.ndarray]]:
    """1000 commands, 230 and 230, and what `truth` made of them, measured."""
    commands = drawn(many, stream(4, "cellwise"))
    moved = truth(commands)
    moved = moved + NOISE * stream(5, "cellwise").standard_normal(moved.shape)
    return [(commands.take(c), moved[c]) for c in (slice(0, 1000), slice(1000, 1230), slice(1230, None))]


def test_without_samples_it_is_the_closed_form() -> None:
    commands = drawn(50, stream(1, "closed"))
    table = Cellwise(Grid(-0.22, 0.22, 4), np.zeros(16, complex), np.zeros(16), TRACK)
    np.testing.assert_allclose(table.predict(commands), kinematic(commands, TRACK), atol=1e-12)
    still = Commands(*(np.array([x]) for x in (0.1, 0.1, 1.0, 0.0, 0.0)))
    np.testing.assert_allclose(table.predict(still), [[0.0, 0.1, 0.0]], atol=1e-12)


def test_what_a_cell_does_otherwise_is_learned_and_done_for_any_time() -> None:
    """Commands ahead to the left slip by 0.02 m/s aside and turn 0.3 rad/s more; only they."""
    grid = Grid(-0.22, 0.22, 2)
    truth = Cellwise(grid, np.array([0, 0, 0, 0.01 + 0.02j]), np.array([0, 0, 0, 0.3]), TRACK)
    parts = halves(truth.predict)
    found = fit_cellwise(*parts[0], parts[1], TRACK)
    assert found.grid.each == 2
    assert found.velocity == pytest.approx(truth.velocity, abs=0.001)
    assert found.turning == pytest.approx(truth.turning, abs=0.01)
    expected = NOISE * np.sqrt(2 / np.pi)
    assert (error(found, *parts[2]) < 1.1 * expected).all()
    assert (error(truth, *parts[2]) > 0.9 * expected).all()


def test_a_wheel_that_turns_less_is_learned_and_a_lag_is_not() -> None:
    def slow(commands: Commands) -> np.ndarray:
        return kinematic(Commands(0.8 * commands.left, *(c for c in commands.columns[1:])), TRACK)

    parts = halves(slow)
    found = fit_cellwise(*parts[0], parts[1], TRACK)
    closed = np.abs(kinematic(parts[2][0], TRACK) - parts[2][1]).mean(axis=0)
    assert found.grid.each >= 5 and (error(found, *parts[2]) < 0.4 * closed).all()
    parts = halves(lambda commands: unicycle(commands, KHEPERA, TRACK))
    found = fit_cellwise(*parts[0], parts[1], TRACK)
    closed = np.abs(kinematic(parts[2][0], TRACK) - parts[2][1]).mean(axis=0)
    assert (error(found, *parts[2]) > 0.8 * closed).all()


def test_speeds_that_differ_by_rounding_are_all_in_a_cell() -> None:
    speeds = np.array([-0.5, 0.0, 0.3, 0.1 + 0.2])
    grid = Grid(-0.5, 0.1 + 0.2, 20)
    assert (grid.cell(speeds, speeds[::-1]) >= 0).all() and grid.cell(speeds, speeds)[2] == 399
    assert (grid.cell(np.array([0.31, -0.51]), np.zeros(2)) == -1).all()


def test_commands_outside_of_all_cells_are_the_closed_form_s() -> None:
    parts = halves(lambda commands: kinematic(commands, 0.1))
    found = fit_cellwise(*parts[0], parts[1], TRACK)
    fast = Commands(*(np.array([x]) for x in (0.4, 0.5, 1.0, 0.0, 0.0)))
    np.testing.assert_allclose(found.predict(fast), kinematic(fast, TRACK), atol=1e-12)
