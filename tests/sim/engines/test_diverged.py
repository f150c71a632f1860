"""One bound tells in every engine with forces that a simulation has left the numbers."""

import numpy as np
import pytest

import dynreg.sim.engines.joint_engine as joint_engine
from dynreg.sim.engines import rollout
from dynreg.sim.engines.diverged import DIVERGED, diverged
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot


def test_once_too_fast_a_simulation_has_diverged_for_good() -> None:
    speeds = np.zeros((3, 5, 2))
    speeds[1, 2, 1] = -1.1 * DIVERGED
    speeds[2, 3, 0] = np.nan
    np.testing.assert_array_equal(diverged(speeds).sum(axis=1), [0, 3, 2])


def test_the_joint_engine_tells_that_a_servo_runs_away(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, integrate = load_robot("servo_pendulum"), joint_engine.integrate

    def runs_away(*told):
        positions, velocities = integrate(*told)
        velocities[1, 7:] *= np.inf
        return positions, velocities

    monkeypatch.setattr(joint_engine, "integrate", runs_away)
    run = excitation(robot, seed=1, episodes=1, steps=20)
    states = rollout(robot, np.tile(robot.space.nominal, (2, 1)), run, engine="joint").states
    assert (
        np.isfinite(states[0]).all()
        and np.isnan(states[1, 0, 7:]).all()
        and np.isfinite(states[1, 0, :7]).all()
    )
