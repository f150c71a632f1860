"""How long compared rollouts are, and where they begin."""

import numpy as np
import secret_servo

from dynreg.compare.rollouts import score
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.sim.config import SimConfig
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot


def test_a_length_that_cannot_be_parted_is_left_out() -> None:
    robot = load_robot("servo_pendulum")
    log = secret_servo.record(secret_servo.values_of(1), 1, episodes=1, steps=500)
    simulators = {"nominal": (robot, SimConfig.of(robot, robot.space.nominal))}
    found = score(robot, log, simulators, [lambda *_: False], "0.25")
    assert [one.seconds for one in found.errors] == [0.1, 0.5, 1.0] and found.too_long == (5.0,)


def test_the_simulator_that_made_a_log_has_no_error_at_any_length() -> None:
    """Of a robot on feet a window from the middle would begin upright and at rest, as the robot was not."""
    robot = load_robot("quadruped")
    run = excitation(robot, seed=1, episodes=5, steps=54, reach=0.3)
    states = rollout(robot, robot.space.nominal[None], run).states[0]
    told = np.concatenate([run.actions, run.actions[:, -1:]], axis=1)
    time = np.arange(states.shape[1]) / robot.rate
    episodes = [
        Episode(f"e{number}", time, table, {s.name: s.nominal for s in robot.file.settings})
        for number, table in enumerate(np.concatenate([states, told], axis=2))
    ]
    channels = tuple(Channel(c.name, c.unit) for c in (*robot.file.channels, *robot.file.actions))
    simulators = {"true": (robot, SimConfig.of(robot, robot.space.nominal))}
    found = score(robot, Recording(channels, tuple(episodes)), simulators, [lambda *_: False])
    assert [one.seconds for one in found.errors] == [0.1, 0.5, 1.0, 1.5]
    assert all(one.rollouts == 5 and one.mean[0, -1] < 0.01 for one in found.errors)
