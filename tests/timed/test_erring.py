"""A model that errs as it did: in commands without a gap, more of it later, the same from the same seed."""

import numpy as np
import pytest

from dynreg.timed.commands import Commands
from dynreg.timed.erring import Erring, consecutive
from dynreg.timed.models import Kinematic

MODEL = Kinematic(0.0884)
OFF = np.arange(9.0)[:, None] * [1.0, 10.0, 100.0]
FOLLOWS = np.array([True, True, True, True, False, True, False, True, True])  # runs of 4, of 2 and of 3


def asked(many: int) -> Commands:
    return Commands(*(np.full(many, value) for value in (0.2, 0.1, 0.4, 0.0, 0.0)))


def drawn(each: int, drives: int, seed: int = 0) -> np.ndarray:
    """(drives, each) numbers of the commands whose errors drives take at the ends of their commands."""
    erring = Erring(MODEL, OFF, consecutive(FOLLOWS, each), each, seed)
    found = erring.along(asked(each * drives), 0.4)[:, 0] - MODEL.predict(asked(each * drives))
    assert found[:, 1] == pytest.approx(10.0 * found[:, 0])
    return np.round(found[:, 0]).astype(int).reshape(drives, each)


def test_runs_do_not_reach_over_gaps() -> None:
    assert consecutive(FOLLOWS, 3).tolist() == [[0, 1, 2], [1, 2, 3], [6, 7, 8]]
    assert consecutive(FOLLOWS, 1).tolist() == [[i] for i in range(9)]
    assert consecutive(FOLLOWS, 6).tolist() == [[0, 1, 2, 3]]
    assert consecutive(np.array([False]), 4).tolist() == [[0]]


def test_a_drive_errs_as_commands_in_a_row_did() -> None:
    numbers = drawn(3, 200)
    assert {*map(tuple, numbers.tolist())} == {(0, 1, 2), (1, 2, 3), (6, 7, 8)}


def test_a_drive_of_more_commands_than_any_run_strings_runs_together() -> None:
    parted = np.array([False, True, False, True])  # two runs of two
    runs = consecutive(parted, 5)
    assert runs.tolist() == [[0, 1], [2, 3]]
    erring = Erring(MODEL, OFF, runs, 5, 0)
    found = erring.along(asked(500), 0.4)[:, 0] - MODEL.predict(asked(500))
    numbers = np.round(found[:, 0]).astype(int).reshape(100, 5)
    assert (numbers[:, 1] == numbers[:, 0] + 1).all() and (numbers[:, 3] == numbers[:, 2] + 1).all()
    assert {*map(tuple, numbers[:, [0, 2, 4]].tolist())} == {
        (a, b, c) for a in (0, 2) for b in (0, 2) for c in (0, 2)
    }


def test_an_error_grows_with_time_and_is_whole_at_the_end() -> None:
    off = np.array([[0.01, -0.02, 0.3]])
    way = Erring(MODEL, off, np.zeros((1, 1), dtype=int), 1, 0).along(asked(1), 0.1)[0]
    sooner = Commands(*(np.array([value]) for value in (0.2, 0.1, 0.1, 0.0, 0.0)))
    assert way[0] - MODEL.predict(sooner)[0] == pytest.approx(off[0] / 4)
    assert way[3] - MODEL.predict(asked(1))[0] == pytest.approx(off[0])


def test_the_same_seed_draws_the_same_errors() -> None:
    first, again, other = (drawn(2, 20, seed) for seed in (0, 0, 1))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    erring = Erring(MODEL, OFF, consecutive(FOLLOWS, 2), 2, 0)
    assert np.array_equal(erring.along(asked(40), 0.2), erring.along(asked(40), 0.2))
    assert erring.along(asked(0), 0.1).shape[0] == 0
