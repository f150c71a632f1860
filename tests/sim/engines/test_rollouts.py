"""Many cases from one batch: each comes out as it would alone."""

from dataclasses import replace

import numpy as np
import pytest
from effect_benches import mixed

from dynreg.sim import engines
from dynreg.sim.effects import effects
from dynreg.sim.engines import Case, rollout, rollouts
from dynreg.sim.excitation import excitation
from dynreg.sim.real import disturbance, disturbed
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import motor_noise

# robot, engine, effects: some act before anything moves, some between time steps, some on the log
BENCHES = {
    "joint": (
        "servo_pendulum",
        ("stribeck_friction", "backlash", "clock_error", "gravity_tilt", "sensor_delay"),
    ),
    "mujoco": ("quadruped", ("load_friction", "thermal_fade", "payload", "imu_misalignment")),
    "kinematic": ("diffdrive", ("rate_limit", "wheel_slip", "wheel_gain", "command_delay")),
    "unicycle": ("diffdrive", ("command_lag", "wheel_slip", "drive_inertia", "turn_slowdown")),
}


def cases(robot: Robot, names: tuple[str, ...]) -> list[Case]:
    """Six: other values, effects, commands, episodes; two with motor noise, one disturbed, one in fewer steps."""
    rng = np.random.default_rng(0)
    runs = [replace(excitation(robot, seed=s, episodes=2 + s % 2, steps=20), begin=None) for s in range(6)]
    values = [robot.space.sample(0, 3, s) for s in range(6)]
    noise = motor_noise(np.array([1, 2, 3]), runs[0].episodes, 20, len(robot.actions))
    own = np.stack([runs[4].actions, 0.5 * runs[4].actions, -runs[4].actions])
    limits = np.full(len(robot.actions), 2.0)
    some = [effects()[name] for name in names]
    rows = [{}, {some[0]: "strong"}, {e: "medium" for e in some}]
    return [
        Case(values[0], replace(runs[0], noise=noise)),
        Case(values[1], runs[1], mixed(robot, rows)),
        Case(values[2], replace(runs[2], noise=noise[:, :2] * 0.5), mixed(robot, rows[::-1])),
        Case(values[3], disturbed(runs[3], limits, rng), disturbance(robot, limits).tiled(3)),
        Case(values[4], replace(runs[4], actions=own)),
        Case(values[5][:2], replace(runs[5], actions=runs[5].actions[:, :15], inputs=None)),
    ]


@pytest.mark.parametrize("engine", BENCHES)
@pytest.mark.parametrize("cut", [False, True])
def test_a_case_is_the_same_alone_and_beside_others(engine: str, cut: bool, monkeypatch: pytest.MonkeyPatch):
    """To the bit, in one batch or in several, on any number of threads."""
    name, some = BENCHES[engine]
    robot = load_robot(name)
    asked = cases(robot, some)
    alone = [rollout(robot, c.values, c.run, engine=engine, threads=1, terms=c.terms) for c in asked]
    if cut:
        monkeypatch.setattr(engines, "LARGEST", 500)
    for threads in (1, 2):
        together = rollouts(robot, asked, engine=engine, threads=threads)
        for one, same in zip(alone, together, strict=True):
            np.testing.assert_array_equal(same.states, one.states)
            np.testing.assert_array_equal(same.fell, one.fell)
            assert same.physics_steps == one.physics_steps
    assert len({states.tobytes() for states in (a.states for a in alone)}) == len(asked)


@pytest.mark.parametrize("engine", BENCHES)
def test_configurations_are_crossed_with_episodes(engine: str):
    """Number b, e of a rollout is configuration b alone in episode e alone."""
    name, some = BENCHES[engine]
    robot = load_robot(name)
    case = cases(robot, some)[2]
    whole = rollout(robot, case.values, case.run, engine=engine, terms=case.terms).states
    for b, e in np.ndindex(*whole.shape[:2]):
        own = case.take(slice(b, b + 1))
        one = rollout(robot, own.values, own.run.take(np.array([e])), engine=engine, terms=own.terms)
        np.testing.assert_array_equal(one.states[0, 0], whole[b, e])


def test_nothing_asked_is_nothing_simulated():
    assert rollouts(load_robot("servo_pendulum"), []) == []
