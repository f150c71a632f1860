"""What moved is named by its pattern, with its size; where nothing moved, nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.commands import Commands
from dynreg.timed.kinematic import kinematic
from dynreg.timed.patterns import PATTERNS, Pattern, ranked
from dynreg.timed.reference import Reference

TRACK = 0.09
NOISE = np.array([0.001, 0.001, 0.01])  # m, m, rad
WITHOUT_LAG = Reference(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0]), TRACK)
FACTORS = {
    "left wheel": (1, 0, 0),
    "right wheel": (0, 1, 0),
    "all speeds": (1, 1, 0),
    "turns only": (0, 0, 1),
}


@pytest.fixture(scope="module")
def grid() -> Commands:
    """Ten speeds for each wheel, held for half a second."""
    left, right = (
        side.ravel() for side in np.meshgrid(np.linspace(-0.1, 0.1, 10), np.linspace(-0.1, 0.1, 10))
    )
    return Commands(left, right, np.full(100, 0.5), left, right)


def shifts(grid: Commands, pattern: str, factor: float, seed: int) -> np.ndarray:
    """What the closed form moves more, measured."""
    left, right, turns = (factor if has else 1.0 for has in FACTORS[pattern])
    told = replace(grid, left=left * grid.left, right=right * grid.right)
    moved = kinematic(told, TRACK / turns) - kinematic(grid, TRACK)
    return moved + NOISE * stream(seed, "shifts").standard_normal(moved.shape)


def explained(grid: Commands, moved: np.ndarray) -> tuple[Pattern, ...]:
    still = WITHOUT_LAG.predict(grid)

    def change(pattern: str, factor: float) -> np.ndarray:
        return WITHOUT_LAG.changed(pattern, factor).predict(grid) - still

    return ranked(change, moved, np.broadcast_to(NOISE, moved.shape))


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("factor", [0.9, 1.15])
def test_every_pattern_is_named_with_its_factor(pattern: str, factor: float, grid: Commands) -> None:
    found = explained(grid, shifts(grid, pattern, factor, 1))
    best = found[0]
    assert best.name == pattern and abs(best.factor - factor) < 4 * best.error < 0.05
    assert best.share > 0.5 and {p.name for p in found} == {*PATTERNS, "no change"}
    assert found[1].bic - best.bic > 10.0


def test_no_change_is_no_pattern(grid: Commands) -> None:
    named = [explained(grid, shifts(grid, "all speeds", 1.0, seed))[0].name for seed in range(20)]
    assert named.count("no change") >= 18


def test_what_was_not_measured_does_not_count(grid: Commands) -> None:
    moved = shifts(grid, "left wheel", 0.8, 2)
    moved[:70] = np.nan
    found = explained(grid, moved)
    assert found[0].name == "left wheel" and abs(found[0].factor - 0.8) < 4 * found[0].error
    nothing = explained(grid, np.full((100, 3), np.nan))
    assert nothing[0].name == "no change"
