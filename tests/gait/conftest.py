"""The quadruped with short trials, in two simulators."""

import pytest
from brief_quadruped import brief, brief_folder, quadruped, short_log  # noqa: F401  fixtures

from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.sim.robot import Robot


@pytest.fixture
def trials(brief: Robot) -> Trials:  # noqa: F811
    """Two simulators: the nominal one, and one with other masses and friction."""
    values = brief.space.sample(0, 2, 1)
    values[0] = brief.space.nominal
    return Trials(brief, task_of(brief), Simulators(values), rate=brief.rate, threads=1)
