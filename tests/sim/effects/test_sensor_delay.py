"""A log that is late: joints that log their speeds go on by these between rows, all else by a straight line."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.sim.effects import Terms, effects, term
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

LATE = effects()["sensor_delay"]
ROW = 0.01  # s


def cubic(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 3.0 * t - 40.0 * t**2 + 500.0 * t**3, 3.0 - 80.0 * t + 1500.0 * t**2


@pytest.mark.parametrize("delay", [0.004, 0.023])
def test_between_rows_a_cubic_is_exact_and_what_logs_no_speed_is_straight(delay: float):
    t = np.arange(8) * ROW
    q, v = cubic(t)
    states = np.stack([q, q, v], axis=1)[None]
    columns = {"position": [0, 1], "velocity": [2], "moving": [0], "moving at": [2]}
    seen = LATE.observe(states, columns, t[None], {"delay": np.array([[delay]])})[0]
    known = t >= delay
    np.testing.assert_allclose(seen[known, 0], cubic(t[known] - delay)[0], rtol=1e-12)
    np.testing.assert_allclose(seen[:, 1], np.interp(t - delay, t, q), rtol=1e-12)
    np.testing.assert_array_equal(seen[~known, :2], np.broadcast_to(states[0, 0, :2], (sum(~known), 2)))


def changed(place: Path, edit, robot: str = "servo_pendulum") -> Path:
    """A packaged robot's folder with another robot.toml."""
    shutil.copytree(load_robot(robot).folder, place)
    text = (place / "robot.toml").read_text(encoding="utf-8")
    (place / "robot.toml").write_text(edit(text), encoding="utf-8")
    return place


def late(robot, run: Run) -> np.ndarray:
    terms = Terms((term("sensor_delay"),), (np.array([[0.004]]),))
    return rollout(robot, robot.space.nominal[None], run, terms=terms, threads=1).states[0]


def test_a_joint_that_logs_no_speed_can_be_late_and_the_order_of_channels_tells_nothing(tmp_path: Path):
    whole = load_robot("servo_pendulum")
    run = excitation(whole, seed=1, episodes=2, steps=50)
    run = replace(run, initial=run.initial * [1.0, 0.0])
    blocks = re.compile(r"\[\[channels\]\]\n(?:(?!\[).*\n)+")
    position, speed = (b for b in blocks.findall((whole.folder / "robot.toml").read_text(encoding="utf-8")))
    alone = load_robot(changed(tmp_path / "alone", lambda text: text.replace(speed, "")))
    swapped = load_robot(
        changed(tmp_path / "swapped", lambda text: text.replace(position + speed, speed + position))
    )
    assert alone.channels == ("arm/position",) and swapped.channels == whole.channels[::-1]
    usual = late(whole, run)
    np.testing.assert_array_equal(late(swapped, replace(run, initial=run.initial[:, ::-1])), usual[..., ::-1])
    straight = late(alone, replace(run, initial=run.initial[:, :1]))[..., 0]
    assert 0.0 < np.abs(straight - usual[..., 0]).max() < 0.02


def test_a_base_that_logs_its_speed_can_be_late(tmp_path: Path):
    logged = '[[channels]]\nname = "base/speed"\nunit = "m/s"\nnoise = 0.01\n\n'
    edit = lambda text: text.replace("[[channels]]", logged + "[[channels]]", 1)  # noqa: E731
    robot = load_robot(changed(tmp_path / "base", edit, "diffdrive"))
    run = excitation(load_robot("diffdrive"), seed=1, episodes=1, steps=50)
    usual, more = (
        late(load_robot("diffdrive"), replace(run, initial=None)),
        late(robot, replace(run, initial=None)),
    )
    assert robot.channels[0] == "base/speed"
    np.testing.assert_array_equal(more[..., 1:], usual)
