"""A simulator stepped by hand is the rollout, to the bit; it can be looked at, pushed and started again."""

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import effect
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.live import LiveSimulator
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run, motor_noise

STEPS = 80  # more than there is room for at first
OUTSIDE = (
    ("command_delay",),
    ("command_lag",),
    ("thermal_fade",),
    ("load_friction",),
    ("backlash",),
    ("joint_elasticity",),
    ("sensor_delay",),
    ("encoder_offset",),
    ("clock_error",),
    ("motor_backlash", "feedback_delay", "torque_lag", "profile_speed"),
    ("rate_limit", "backlash", "stribeck_friction", "sensor_delay", "encoder_scale"),
)
INSIDE = ((), ("payload",), ("coulomb_friction", "torque_limit", "gravity_tilt"))


def config_of(robot: Robot, names: tuple[str, ...] = (), **values: float) -> SimConfig:
    """A random simulator of the robot, with these effects of medium size and these parameters."""
    effects = {name: {p.name: p.medium for p in effect(name).parameters} for name in names}
    known = robot.space.as_dict(robot.space.sample(0, 1, 0)[0]) | values
    return SimConfig(robot.hash, robot.name, known, effects)


def run_of(robot: Robot, steps: int = STEPS) -> Run:
    """One episode of commands, with the settings and the start that belong to it, and nominal inputs."""
    return replace(excitation(robot, seed=1, episodes=1, steps=steps), inputs=None)


def told(robot: Robot, run: Run) -> Mapping[str, float]:
    return {} if run.settings is None else dict(zip(robot.settings, run.settings[0], strict=True))


def rolled(robot: Robot, config: SimConfig, run: Run) -> np.ndarray:
    """(T+1, S) the states of the engine."""
    values, terms = robot.space.from_dict(dict(config.values)), terms_of(config, robot)
    return rollout(robot, values[None], run, engine="mujoco", terms=terms if terms.terms else None).states[
        0, 0
    ]


def stepped(live: LiveSimulator, run: Run) -> np.ndarray:
    """(T+1, S) from the start of the run on."""
    start = live.reset(None if run.initial is None else run.initial[0])
    return np.stack([start, *(live.step(action) for action in run.actions[0])])


@pytest.mark.parametrize("names", [*INSIDE, *OUTSIDE], ids="+".join)
@pytest.mark.parametrize("name", ["servo_pendulum", "leg", "quadruped"])
def test_stepping_is_the_rollout(name: str, names: tuple[str, ...]) -> None:
    robot = load_robot(name)
    config, run = config_of(robot, names), run_of(robot)
    live = LiveSimulator(robot, config, settings=told(robot, run))
    states, plain = stepped(live, run), rolled(robot, config_of(robot), run)
    wanted = rolled(robot, config, run)
    assert np.isfinite(wanted).all() and states.shape == (STEPS + 1, len(live.channels))
    assert np.array_equal(states, wanted)
    assert np.array_equal(wanted, plain) == (not names), "the effects act"
    assert live.outside == (names if names in OUTSIDE else ())


def test_effects_outside_the_model_are_those_that_mj_step_loses() -> None:
    robot = load_robot("servo_pendulum")
    run = run_of(robot)

    def by_mujoco(config: SimConfig) -> np.ndarray:
        live = LiveSimulator(robot, config, settings=told(robot, run))
        live.reset(run.initial[0])
        low, high = robot.action_ranges.T
        for action in run.actions[0]:
            live.data.ctrl[:] = np.clip(action, low, high)
            mujoco.mj_step(live.model, live.data, round(live.period / live.model.opt.timestep))
        return live.state

    inside, outside = (config_of(robot, names) for names in (("payload", "coulomb_friction"), ("backlash",)))
    assert np.array_equal(by_mujoco(inside), rolled(robot, inside, run)[-1])
    assert not np.allclose(by_mujoco(outside), rolled(robot, outside, run)[-1])


@pytest.mark.parametrize("names", [(), ("backlash", "thermal_fade", "sensor_delay")], ids="+".join)
def test_a_reset_gives_the_same_run_again(names: tuple[str, ...]) -> None:
    robot = load_robot("quadruped")
    run = run_of(robot, steps=30)
    live = LiveSimulator(robot, config_of(robot, names, action_rate=40.0))
    model, data, start = live.model, live.data, live.state
    first = stepped(live, run)
    assert live.time == pytest.approx(30 / 40) and live.period == 1 / 40
    data.xfrc_applied[1, 2], data.qvel[:], model.body_mass[1] = 5.0, 0.3, 9.0
    live.step(run.actions[0, 0])
    assert np.array_equal(live.reset(), start) and live.time == 0.0
    assert np.array_equal(stepped(live, run), first)
    assert live.model is model and live.data is data, "whoever draws them goes on drawing them"


def test_a_start_that_is_known_in_part() -> None:
    robot = load_robot("leg")
    live = LiveSimulator(robot, config_of(robot, ("encoder_offset",)))
    settled = live.state
    state = live.reset([np.nan, 0.4, *[np.nan] * 4])
    assert state[1] == pytest.approx(0.4), "as the encoder reads it"
    assert np.array_equal(np.delete(state, 1), np.delete(settled, 1))
    assert np.array_equal(live.reset(), settled)


@pytest.mark.parametrize("names", [(), ("load_friction", "sensor_delay")], ids="+".join)
def test_to_look_changes_nothing(names: tuple[str, ...]) -> None:
    robot = load_robot("quadruped")
    run = run_of(robot, steps=30)
    live = LiveSimulator(robot, config_of(robot, names))
    wanted = stepped(live, run)
    live.reset()
    for action, after in zip(run.actions[0], wanted[1:], strict=True):
        mujoco.mj_forward(live.model, live.data)
        assert np.array_equal(live.step(action), after) and np.array_equal(live.state, after)


@pytest.mark.parametrize("names", [(), ("command_lag",)], ids="+".join)
def test_a_user_can_push(names: tuple[str, ...]) -> None:
    robot = load_robot("servo_pendulum")
    live, left = (LiveSimulator(robot, config_of(robot, names)) for _ in range(2))
    hold = [0.0]
    live.data.qvel[0] = 3.0
    assert live.state[1] == 3.0
    pushed, still = live.step(hold), left.step(hold)
    assert pushed[0] > still[0] + 0.5 * 3.0 * live.period
    moved = live.time
    live.data.qpos[0] = 1.0
    assert live.state[0] == 1.0 and live.time == moved


def test_a_sensor_that_is_late_shows_a_push_late() -> None:
    robot = load_robot("servo_pendulum")
    config = config_of(robot, ("sensor_delay",))
    config = replace(config, effects={"sensor_delay": {"delay": 2 / robot.rate}})
    live = LiveSimulator(robot, config)
    live.step([0.0])
    live.data.qvel[0] = 3.0
    speeds = [live.step([0.0])[1] for _ in range(2)]
    assert abs(speeds[0]) < 1.0 and speeds[1] == 3.0


def test_noise_is_that_of_the_seed() -> None:
    robot = load_robot("quadruped")
    run, config = run_of(robot, steps=20), config_of(robot, motor_noise=0.02)
    live = LiveSimulator(robot, config, seed=7)
    noisy = replace(run, noise=motor_noise(np.array([7]), 1, 20, len(robot.actions))[0])
    first = stepped(live, run)
    assert np.array_equal(first, rolled(robot, config, noisy)) and np.array_equal(first, stepped(live, run))
    assert not np.array_equal(first, rolled(robot, config, run))
    assert np.array_equal(stepped(LiveSimulator(robot, config), run), rolled(robot, config, run))


def test_inputs_can_change_on_the_way() -> None:
    robot = load_robot("servo_pendulum")
    run, config = run_of(robot, steps=30), config_of(robot, ("command_lag",))
    inputs = np.tile(robot.input_defaults, (1, 30, 1))
    inputs[0, 10:, robot.inputs.index("supply")] = 5.0
    inputs[0, 20:, robot.inputs.index("arm/enabled")] = 0.0
    live = LiveSimulator(robot, config, settings=told(robot, run))
    states = [live.reset(run.initial[0])]
    for t, action in enumerate(run.actions[0]):
        states.append(live.step(action, inputs={10: {"supply": 5.0}, 20: {"arm/enabled": 0}}.get(t)))
    assert np.array_equal(states, rolled(robot, config, replace(run, inputs=inputs)))
    low = replace(run, inputs=inputs[:, 10:11].repeat(30, axis=1))
    weak = LiveSimulator(robot, config, settings=told(robot, run), inputs={"supply": 5.0})
    assert np.array_equal(stepped(weak, run), rolled(robot, config, low))
    weak.reset(run.initial[0])
    again = weak.step(run.actions[0, 0], inputs={"arm/enabled": 1.0})
    assert np.array_equal(again, rolled(robot, config, low)[1]), "what is not named stays as it was"


def test_settings_and_period_are_told() -> None:
    robot = load_robot("servo_pendulum")
    run, config = run_of(robot, steps=20), config_of(robot)
    run = replace(run, settings=np.array([[800.0, 0.1]]), period=0.02)
    live = LiveSimulator(robot, config, settings={"kp": 800, "added_mass": 0.1}, period=0.02)
    assert np.array_equal(stepped(live, run), rolled(robot, config, run))
    assert live.period == 0.02 and live.time == pytest.approx(0.4)


def test_what_diverges_is_unknown_until_a_reset() -> None:
    live = LiveSimulator(load_robot("leg"), config_of(load_robot("leg")))
    live.data.qvel[0] = 1e6
    assert np.isnan(live.state).all() and np.isnan(live.step(np.zeros(3))).all()
    live.reset()
    live.data.qvel[0] = 1e6
    live.step(np.zeros(3))
    live.data.qpos[:], live.data.qvel[:] = 0.0, 0.0
    assert np.isnan(live.state).all() and np.isnan(live.step(np.zeros(3))).all()
    assert np.isfinite(live.reset()).all()


ARM = load_robot("servo_pendulum")


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda live: live.step([0.0, 0.0]), r"an action of shape \(2,\); expected \(1,\), .*arm/target"),
        (lambda live: live.step(0.0), r"an action of shape \(\)"),
        (lambda live: live.step([np.nan]), "an action with nan; expected finite numbers"),
        (lambda live: live.step(["up"]), r"an action of \['up'\]"),
        (lambda live: live.step([0.0], inputs={"voltage": 5.0}), "unknown input 'voltage'; .*'supply'"),
        (lambda live: live.step([0.0], inputs={"supply": np.inf}), "input 'supply' of inf"),
        (lambda live: live.reset([0.0]), r"a state of shape \(1,\); expected \(2,\), .*arm/position"),
        (lambda live: live.reset([0.0, np.inf]), "a state with an infinite number"),
    ],
)
def test_what_is_told_on_the_way_is_checked(ask, said: str) -> None:
    live = LiveSimulator(ARM, config_of(ARM))
    before = live.state
    with pytest.raises(UsageError, match=said):
        ask(live)
    assert live.time == 0.0 and np.array_equal(live.state, before)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"settings": {"kd": 1.0}}, "unknown setting 'kd'; expected one of .*'kp'"),
        ({"settings": {"kp": "high"}}, "setting 'kp' of 'high'"),
        ({"inputs": {"arm": 1.0}}, "unknown input 'arm'"),
        ({"period": 0.0}, "period 0.0; expected seconds, above 0"),
        ({"seed": 0.5}, "seed 0.5; expected a whole number"),
    ],
)
def test_what_is_told_at_first_is_checked(told: dict, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        LiveSimulator(ARM, config_of(ARM), **told)


def test_a_base_that_is_not_in_mujoco_is_not_stepped() -> None:
    robot = load_robot("diffdrive")
    with pytest.raises(UsageError, match="does not run on MuJoCo; .*'kinematic', 'unicycle'.*dynreg compare"):
        LiveSimulator(robot, SimConfig.of(robot, robot.space.nominal))
