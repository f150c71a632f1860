"""The way between the begin and the end of commands: models that know it and models that are asked again agree."""

import numpy as np
import pytest

from dynreg.timed.commands import Commands
from dynreg.timed.models import Continuous, Kinematic, Model, Unicycle, along, coarse
from dynreg.timed.unicycle import KHEPERA

TRACK = 0.0884


class Asked:
    """A unicycle that tells only ends."""

    def __init__(self, step: float):
        self.model = Unicycle(KHEPERA, TRACK, step)

    def predict(self, commands: Commands) -> np.ndarray:
        return self.model.predict(commands)


@pytest.fixture(scope="module")
def commands() -> Commands:
    rows = [(0.1, 0.2, 0.0, 0.0, 0.0), (0.2, -0.1, 0.25, 0.1, 0.2), (0.05, 0.1, 0.2, 0.2, -0.1)]
    return Commands(*np.array(rows).T)


def test_both_ways_have_a_point_at_every_end_also_of_a_command_of_no_time(commands: Commands) -> None:
    found, asked = (along(model, commands, 0.1) for model in (Unicycle(KHEPERA, TRACK, 0.001), Asked(0.001)))
    assert found.shape == asked.shape == (3, 3, 3)
    assert np.isfinite(asked).all(axis=2).sum(axis=1).tolist() == [1, 3, 2]
    assert np.allclose(found, asked, atol=1e-9, equal_nan=True) and not asked[0, 0].any()
    still = Commands(*(column[:1] for column in commands.columns))
    assert (
        along(Asked(0.01), still, 0.1).shape == along(Unicycle(KHEPERA, TRACK), still, 0.1).shape == (1, 1, 3)
    )


def test_who_knows_the_way_is_told_by_a_protocol() -> None:
    models: list[Model] = [Unicycle(KHEPERA, TRACK), Kinematic(TRACK), Asked(0.01)]
    assert [isinstance(model, Continuous) for model in models] == [True, False, False]


def test_a_search_asks_the_unicycle_in_steps_that_its_lags_allow() -> None:
    plain = Kinematic(TRACK)
    assert coarse(plain) is plain
    for lag, step in ((0.087, 0.0435), (0.3, 0.05), (0.01, 0.01)):
        parameters = KHEPERA.copy()
        parameters[0], parameters[1] = lag, 0.4
        assert coarse(Unicycle(parameters, TRACK)).step == pytest.approx(step)
