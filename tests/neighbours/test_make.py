"""Windows that begin anew without the errors of their start states begin nearer the true ones."""

from dataclasses import replace

import numpy as np
import secret_servo

from dynreg.neighbours.make import Replaying
from dynreg.replay.cut import windows
from dynreg.replay.windows import Replayer
from dynreg.rng import stream
from dynreg.sim.robot import load_robot

VALUES = secret_servo.values_of(1)


def replaying(believed: bool) -> tuple[Replaying, np.ndarray]:
    """The servo itself, replayed from starts with noise; and the true starts (W, S)."""
    robot, rng = load_robot("servo_pendulum"), stream(3, "starts")
    cut = windows(robot, secret_servo.record(VALUES, 1, episodes=20, steps=60))
    chosen = np.arange(len(cut))
    true = Replayer(robot, cut).states(VALUES[None], chosen)[0]
    measured = true + robot.sensor_noise * rng.standard_normal(true.shape)
    run = replace(cut.run, initial=measured[:, 0])
    replayer = Replayer(robot, replace(cut, run=run, measured=measured))
    return Replaying(replayer, chosen, robot.space.from_unit, lambda: None, believed), true[:, 0]


def test_moved_starts_are_nearer_the_true_ones_and_so_is_the_replay():
    one, true = replaying(believed=False)
    unit = one.replayer.robot.space.to_unit(VALUES)
    (residual,) = one.residuals(unit[None])
    moved = one.moved(one.slopes(unit, residual).errors(residual), residual)
    measured = one.replayer.windows.run.initial
    noise = one.replayer.robot.sensor_noise
    before, after = (np.sqrt(np.mean(((x - true) / noise) ** 2, axis=0)) for x in (measured, moved.initial))
    assert (after < 0.6 * before).all()
    assert np.abs(moved.residuals(unit[None])).mean() < 0.9 * np.abs(residual).mean()


def test_believed_starts_are_not_moved():
    one, _ = replaying(believed=True)
    unit = one.replayer.robot.space.to_unit(VALUES)
    (residual,) = one.residuals(unit[None])
    moved = one.moved(one.slopes(unit, residual).errors(residual), residual)
    np.testing.assert_array_equal(moved.initial, one.replayer.windows.run.initial)
