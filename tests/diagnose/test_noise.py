"""The noise of a log: what is white counts, what a motion changes from row to row does not."""

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.noise import noisier, own_noise, scatter
from dynreg.sim.robot import load_robot


def swing(rate: float, hertz: float, noise: float, seconds: float = 10.0) -> np.ndarray:
    """(T,) a sine of 1 rad with white noise of so much [rad]."""
    t = np.arange(round(seconds * rate)) / rate
    return np.sin(2 * np.pi * hertz * t) + noise * np.random.default_rng(0).standard_normal(len(t))


@pytest.mark.parametrize(
    ("rate", "hertz"), [(50.0, 2.0), (50.0, 3.0), (100.0, 3.0), (100.0, 4.0), (200.0, 8.0)]
)
def test_motion_is_no_noise(rate, hertz):
    assert scatter([swing(rate, hertz, 0.0)]) < 2e-4
    assert scatter([swing(rate, hertz, 0.01)]) == pytest.approx(0.01, rel=0.15)


def test_only_what_is_more_than_twice_the_stated_noise_is_told_and_logs_of_one_sensor_alike():
    robot = load_robot("servo_pendulum")
    (stated,) = (s for c, s in zip(robot.file.channels, robot.sensor_noise, strict=True) if c.weight > 0)

    def log(times: float) -> Recording:
        values = swing(100.0, 0.5, times * stated)[:, None]
        episode = Episode("a", np.arange(len(values)) / 100.0, values, {})
        return Recording((Channel("arm/position", "rad"),), (episode,), True)

    assert own_noise(robot, log(1.0)) == own_noise(robot, log(1.7)) == {}
    assert (
        own_noise(robot, log(3.7))
        == own_noise(robot, log(4.4))
        == {"arm/position": pytest.approx(4 * stated)}
    )
    assert noisier(robot, {}) is robot
    assert noisier(robot, {"arm/position": 0.1}).file.channels[0].noise == 0.1
