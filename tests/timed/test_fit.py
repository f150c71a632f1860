"""The genetic algorithm finds the parameters that moved a robot."""

from dataclasses import replace

import numpy as np

from dynreg.rng import stream
from dynreg.timed import fit
from dynreg.timed.commands import drawn
from dynreg.timed.fit import RANGES, Breeding, fit_unicycle
from dynreg.timed.unicycle import LAUT, unicycle

TRACK = 0.0884


def test_the_parameters_of_a_robot_are_found() -> None:
    commands = drawn(60, stream(5, "commands"), seconds=(0.1, 0.6))
    moved = unicycle(commands, LAUT, TRACK)
    cut, rest = slice(0, 40), slice(40, 60)
    unseen = (commands.take(rest), moved[rest])
    given = Breeding(generations=25, population=40, tournament=8)
    found = fit_unicycle(commands.take(cut), moved[cut], unseen, TRACK, given)
    assert found.history.shape == (25,) and found.history[-1] < 0.1 * found.history[0]
    scale = np.ptp(RANGES, axis=1)
    assert (np.abs(found.parameters - LAUT) / scale)[[0, 1, 3, 5]].max() < 0.15  # the couplings hardly show
    assert found.validation < 0.02 and found.error >= found.history.min()
    again = fit_unicycle(commands.take(cut), moved[cut], unseen, TRACK, given, threads=2)
    assert np.array_equal(again.parameters, found.parameters)


def test_a_first_guess_that_diverges_on_the_validation_part_does_not_stay(monkeypatch) -> None:
    """A comparison with NaN is always false."""
    commands = drawn(20, stream(5, "commands"), seconds=(0.1, 0.6))
    moved = unicycle(commands, LAUT, TRACK)
    real, seen = fit._errors, []

    def first_diverges(parameters, *rest, **more):
        if len(parameters) > 1:
            return real(parameters, *rest, **more)
        seen.append(parameters[0])
        return np.array([np.nan]) if len(seen) == 1 else real(parameters, *rest, **more)

    monkeypatch.setattr(fit, "_errors", first_diverges)
    given = Breeding(generations=8, population=40, tournament=8)
    found = fit_unicycle(commands, moved, (commands, moved), TRACK, given)
    assert len(seen) > 1 and np.isfinite(found.validation)


def test_what_the_validation_likes_best_is_kept() -> None:
    """Its displacements are another robot's: the answer is near that one at some time, and no more later."""
    commands = drawn(60, stream(6, "commands"), seconds=(0.1, 0.6))
    moved, other = unicycle(commands, LAUT, TRACK), unicycle(commands, LAUT * [6, 3, 1, 1, 1, 1], TRACK)
    cut, rest = slice(0, 40), slice(40, 60)
    given = Breeding(generations=25, population=40, tournament=8, seed=1)
    found = fit_unicycle(commands.take(cut), moved[cut], (commands.take(rest), other[rest]), TRACK, given)
    assert found.error > found.history.min()


def test_rounding_of_an_axis_that_is_not_driven_fits_nothing() -> None:
    """Straight ahead, 1e-8 m and rad of rounding counted as much as the way."""
    commands = drawn(40, stream(7, "commands"), seconds=(0.1, 0.6))
    straight = replace(commands, right=commands.left, right_before=commands.left_before)
    moved = unicycle(straight, LAUT, TRACK) * [0.0, 1.0, 0.0]
    noise = 1e-8 * stream(7, "rounding").standard_normal(moved.shape) * [1.0, 0.0, 1.0]
    given = Breeding(generations=10, population=40, tournament=8)
    found = [fit_unicycle(straight, one, (straight, one), TRACK, given) for one in (moved, moved + noise)]
    assert np.array_equal(found[0].parameters, found[1].parameters)
