"""What another cut of a recording shows of what is held out."""

from dataclasses import replace

import numpy as np
import secret_servo

from dynreg.methods.judged import saw
from dynreg.replay.cut import windows
from dynreg.replay.data import Data, data
from dynreg.sim.robot import Robot, load_robot


def cut_by(robot: Robot, horizon: float) -> Robot:
    table = robot.file.replay.model_copy(update={"horizon": horizon})
    return replace(robot, file=robot.file.model_copy(update={"replay": table}))


def recorded(episodes: int) -> Data:
    robot = cut_by(load_robot("servo_pendulum"), 0.3)
    log = secret_servo.record(secret_servo.values_of(3), 3, episodes=episodes, steps=240)
    return data(robot, log)


def test_the_same_cut_shows_nothing_of_it() -> None:
    held = recorded(2)
    assert held.parts.test.any() and saw(held, held.windows, held.parts.chosen) == ()


def test_longer_windows_show_the_pieces_that_they_reach_into() -> None:
    held = recorded(2)
    longer = windows(cut_by(held.robot, 0.6), held.recording)
    every = np.arange(len(longer))
    assert saw(held, longer, every) == held.named["test"]
    first = held.windows.rows[np.flatnonzero(held.parts.test)[0]]
    apart = [v for v in every if longer.rows[v, 1] - 1 <= first[0] or longer.rows[v, 0] >= first[1] - 1]
    assert held.named["test"][0] not in saw(held, longer, np.array(apart))


def test_whole_episodes_that_are_held_out_are_not_seen_by_any_cut_of_the_others() -> None:
    held = recorded(5)
    longer = windows(cut_by(held.robot, 0.6), held.recording)
    fitted = np.unique(held.windows.episode[held.parts.chosen])
    assert saw(held, longer, np.flatnonzero(np.isin(longer.episode, fitted))) == ()
