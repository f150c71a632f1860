"""A model that errs as it did: in commands in a row, more of it later, the same from the same seed."""

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed.commands import Commands
from dynreg.timed.erring import Erring
from dynreg.timed.models import Kinematic

MODEL = Kinematic(0.0884)
OFF = np.arange(7.0)[:, None] * [1.0, 10.0, 100.0]


def asked(many: int) -> Commands:
    return Commands(*(np.full(many, value) for value in (0.2, 0.1, 0.4, 0.0, 0.0)))


def test_a_drive_errs_as_commands_in_a_row_did() -> None:
    found = Erring(MODEL, OFF, 4, stream(0, "drives")).predict(asked(400)) - MODEL.predict(asked(400))
    drives = found.reshape(100, 4, 3)
    assert drives[..., 1] == pytest.approx(10.0 * drives[..., 0])
    numbers = np.round(drives[..., 0]).astype(int)
    assert ((np.diff(numbers, axis=1) % 7) == 1).all() and {*numbers[:, 0]} == {*range(7)}


def test_an_error_grows_with_time_and_is_whole_at_the_end() -> None:
    off = np.array([[0.01, -0.02, 0.3]])
    way = Erring(MODEL, off, 1, stream(0, "drives")).along(asked(1), 0.1)[0]
    sooner = Commands(*(np.array([value]) for value in (0.2, 0.1, 0.1, 0.0, 0.0)))
    assert way[0] - MODEL.predict(sooner)[0] == pytest.approx(off[0] / 4)
    assert way[3] - MODEL.predict(asked(1))[0] == pytest.approx(off[0])


def test_the_same_stream_draws_the_same_errors() -> None:
    first, again, other = (
        Erring(MODEL, OFF, 2, stream(seed, "drives")).predict(asked(40)) for seed in (0, 0, 1)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert Erring(MODEL, OFF, 2, stream(0, "drives")).predict(asked(0)).shape == (0, 3)
