"""Delays look back beyond the start of a run, at the commands that were told before it."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

CUT, KNOWN = 19, 10  # the command that a run is cut at, one after a change; commands before it that are known
BENCHES = (
    ("kinematic", "diffdrive", 0.1),
    ("unicycle", "diffdrive", 0.1),
    ("mujoco", "servo_pendulum", 0.025),
    ("joint", "servo_pendulum", 0.025),
)


def played(robot: Robot, run: Run, engine: str, delay: float) -> np.ndarray:
    """(T+1, S) states under commands that arrive late."""
    late = Terms((term("command_delay"),), (np.array([[delay]]),))
    return rollout(robot, robot.space.nominal[None], run, engine=engine, terms=late).states[0, 0]


@pytest.mark.parametrize("engine, name, delay", BENCHES)
def test_a_run_goes_on_as_it_would_have_and_begins_anew_where_nothing_is_known(
    engine: str, name: str, delay: float
) -> None:
    robot = load_robot(name)
    rng, most = np.random.default_rng(0), [min(a.high, 1.0) for a in robot.file.actions]
    told = (rng.uniform(-1.0, 1.0, (1, 8, len(most))) * most).repeat(6, axis=1)
    run = Run(told, period=1.0 / robot.rate)
    whole = played(robot, run, engine, delay)
    rest = replace(run, actions=told[:, CUT:], initial=whole[None, CUT])
    unknown = np.full((1, 5, len(most)), np.nan)
    before = np.concatenate([unknown, told[:, CUT - KNOWN : CUT]], axis=1)
    on = played(robot, replace(rest, before=before), engine, delay)
    np.testing.assert_allclose(on, whole[CUT:], rtol=0.0, atol=1e-12)
    anew = played(robot, rest, engine, delay)
    assert np.abs(anew - whole[CUT:]).max() > 0.05
    np.testing.assert_array_equal(played(robot, replace(rest, before=unknown), engine, delay), anew)
