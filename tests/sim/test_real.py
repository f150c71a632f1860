"""The door to a hidden robot: what trials cost is counted, the budget is kept, and the truth is no model's."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.errors import BudgetError, UsageError
from dynreg.evidence.hypothesis import Coordinates
from dynreg.replay.known import nominal_known
from dynreg.rng import stream
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.real import (
    DISTURBANCE,
    Budget,
    Secret,
    SimulatedRobot,
    Spent,
    disturbance,
    disturbed,
    drive_limits,
    finer,
    sensed,
)
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.spec import RobotTable

ROBOT = load_robot("quadruped")
POSE = ROBOT.model.keyframe("stance").ctrl
STAND = np.tile(POSE, (18, 1))  # half a second
TUMBLE = excitation(ROBOT, seed=3, episodes=1, steps=90).actions[0]


def hidden(**budget) -> SimulatedRobot:
    return SimulatedRobot(
        ROBOT,
        ROBOT.space.nominal,
        (term("coulomb_friction"),),
        (np.array([0.1]),),
        seed=5,
        budget=Budget(**budget),
    )


def test_trials_seconds_and_falls_are_counted() -> None:
    real = hidden()
    stood, fallen = real.run(STAND, 36.0), real.run(TUMBLE, 36.0)
    assert not stood.fell and fallen.fell
    assert real.spent.trials == 2 and real.spent.falls == 1
    ended = fallen.walk.fell[0, 0] / 36.0
    assert ended < 90 / 36.0  # it was not let lie there
    assert real.spent.seconds == pytest.approx(0.5 + ended)
    assert len(fallen.recording.episodes[0].time) == fallen.walk.fell[0, 0] + 1


@pytest.mark.parametrize(
    "budget, says",
    [({"trials": 1}, "1 trials"), ({"seconds": 0.9}, "0.9 seconds"), ({"falls": 0}, "0 falls")],
)
def test_a_spent_budget_is_refused_before_anything_moves(budget: dict, says: str) -> None:
    real = hidden(**budget)
    if "falls" not in budget:
        real.run(STAND, 36.0)
    before = real.spent
    with pytest.raises(BudgetError, match=says):
        real.run(STAND, 36.0)
    assert real.spent == before


def test_commands_that_are_none_cost_nothing() -> None:
    real = hidden()
    with pytest.raises(UsageError, match="commands of shape"):
        real.run(STAND[:, :5], 36.0)
    lost = STAND.copy()
    lost[3, 2] = np.nan
    for actions, rate, says in (
        (STAND[:0], 36.0, "commands of shape"),
        (lost, 36.0, "command nan in step 3"),
        (STAND, 0.0, "rate = 0"),
    ):
        with pytest.raises(UsageError, match=says):
            real.run(actions, rate)
    assert real.spent == Spent()


def test_the_truth_is_repeatable_noisy_and_no_simulator_of_the_family() -> None:
    logs = [hidden().run(STAND, 36.0).recording for _ in range(2)]
    assert logs[0].id == logs[1].id
    real = hidden()
    assert real.run(STAND, 36.0).recording.id != real.run(STAND, 36.0).recording.id  # noise of its own
    run = Run(STAND[None], period=1 / 36.0)
    model = rollout(ROBOT, ROBOT.space.nominal[None], run, threads=1).states[0, 0]
    seen = logs[0].episodes[0].values[:, : len(ROBOT.channels)]
    assert np.abs(seen - model).max() > 0.01
    counts = seen[:, :12] * 4096 / (2 * np.pi)
    assert np.allclose(counts, np.round(counts), atol=1e-6)


def test_where_nothing_collides_the_truth_does_not_act_half_a_time_step_early() -> None:
    robot = load_robot("servo_pendulum")
    commands = excitation(robot, seed=0, episodes=2, steps=60)
    late = Terms((term("command_delay"),), (np.array([[0.01]]),))

    def position(truth: Robot) -> np.ndarray:
        return rollout(truth, robot.space.nominal[None], commands, engine="mujoco", terms=late).states[
            0, ..., 0
        ]

    def stepped(table: RobotTable, finer: int, integrator: str) -> Robot:
        table = table.model_copy(update={"timestep": table.timestep / finer, "integrator": integrator})
        return replace(robot, file=robot.file.model_copy(update={"robot": table}))

    exact = position(stepped(robot.file.robot, 160, "implicitfast"))
    first_order = position(stepped(robot.file.robot, 10, "implicitfast"))
    assert np.abs(position(finer(robot)) - exact).max() < 0.4 * np.abs(first_order - exact).max()
    assert finer(ROBOT).model.opt.integrator == ROBOT.model.opt.integrator  # feet collide


@pytest.mark.parametrize("name", ["servo_pendulum", "diffdrive", "two_joint_arm"])
def test_arms_servos_and_bases_on_wheels_have_the_same_door(name: str) -> None:
    robot = load_robot(name)
    actions = excitation(robot, seed=1, episodes=1, steps=50).actions[0]
    real = SimulatedRobot(robot, robot.space.nominal, seed=2, budget=Budget(trials=2))
    first, second = real.run(actions, robot.rate), real.run(actions, robot.rate)
    assert first.walk is None and not first.fell
    assert real.spent == Spent(2, 2 * 50 / robot.rate, 0)
    logs = [one.recording.episodes[0].values for one in (first, second)]
    assert logs[0].shape == (51, len(robot.channels) + len(robot.actions))
    assert not np.array_equal(*logs) and np.abs(logs[0] - logs[1]).max() < 1.0, "noise of its own, no more"
    with pytest.raises(BudgetError, match="2 trials"):
        real.run(actions, robot.rate)


def test_sensors_are_as_fine_as_robot_toml_states() -> None:
    """The linear encoder of `emps` resolves micrometres; a joint that turns has ticks where it states none."""
    emps, still = load_robot("emps"), np.zeros((500, 1))
    read = sensed(emps, np.tile([0.1, 0.0], (500, 1)), np.random.default_rng(0))[:, :1]
    assert 0.5e-6 < (read - 0.1).std() < 2e-6
    bare = emps.file.channels[0].model_copy(update={"noise": 0.0})
    unstated = replace(emps, file=emps.file.model_copy(update={"channels": [bare]}))
    assert 0.3e-3 < sensed(unstated, still, np.random.default_rng(0)).std() < 0.7e-3


def test_a_robot_that_wears_is_another_from_a_trial_on() -> None:
    robot = load_robot("servo_pendulum")
    actions = excitation(robot, seed=1, episodes=1, steps=50).actions[0]
    heavy = robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | {"tip_mass": 0.6})

    def logs(**changes) -> list[np.ndarray]:
        real = SimulatedRobot(robot, robot.space.nominal, seed=2, **changes)
        return [real.run(actions, robot.rate).recording.episodes[0].values for _ in range(4)]

    same, worn = logs(), logs(changes={2: Secret(heavy)})
    assert all(np.array_equal(a, b) for a, b in zip(same[:2], worn[:2], strict=True))
    assert all(np.abs(a - b).max() > 0.01 for a, b in zip(same[2:], worn[2:], strict=True))


@pytest.mark.parametrize("name", ["two_joint_arm", "create"])
def test_each_drive_is_disturbed_by_a_share_of_its_own_limit(name: str) -> None:
    """Drives of 12 and 6 N m; a base that is told m/s and rad/s."""
    robot = load_robot(name)
    limits = Coordinates(robot, nominal_known(robot)).drive_limits
    assert limits[0] != limits[1] and (limits == drive_limits(robot)).all()
    run = disturbed(Run(np.zeros((2, 5000, 2))), limits, stream(0, "disturbed"))
    ((size,),) = disturbance(robot, limits).values[0]
    assert size * run.draws.std(axis=(0, 1)) == pytest.approx(DISTURBANCE * limits, rel=0.05)


def test_drives_that_are_alike_have_plain_draws_and_those_without_a_limit_none() -> None:
    alike, one = (
        disturbed(Run(np.zeros((1, 9, 4))), of, stream(1)).draws for of in (np.ones(4), np.eye(4)[0])
    )
    plain = stream(1).standard_normal((1, 9, 4))
    np.testing.assert_array_equal(alike, plain)
    np.testing.assert_array_equal(one, plain * [4.0, 0.0, 0.0, 0.0])
    assert disturbance(ROBOT, np.zeros(12)).values[0] == 0.0
