"""The packaged leg: it hangs in the air or stands, whatever pose it starts in."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.sim.engines import Arena, rollout
from dynreg.sim.excitation import excitation, reset_pose
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.sim.spec import ChannelTable

AIR, GROUND = 0.5, 0.2  # height [m] of the rail's lower stop


@pytest.fixture(scope="module")
def leg() -> Robot:
    return load_robot("leg")


def _with_rail(robot: Robot) -> Robot:
    """The robot with the carriage's height above the stop as its last channel."""
    rail = ChannelTable(name="rail/position", unit="m")
    return replace(robot, file=robot.file.model_copy(update={"channels": [*robot.file.channels, rail]}))


def _heights(robot: Robot, actions: np.ndarray, stop: float, **run) -> np.ndarray:
    """(E, T+1) carriage above the stop [m], from the reset pose."""
    settings = np.full((len(actions), 1), stop)
    run = Run(actions, settings=settings, **run)
    return rollout(_with_rail(robot), robot.space.nominal[None], run).states[0, ..., -1]


def test_in_the_air_the_carriage_stays_on_its_stop(leg: Robot):
    bank = excitation(leg, seed=1, episodes=8, steps=50)
    assert np.abs(_heights(leg, bank.actions, AIR, inputs=bank.inputs)).max() < 1e-3


def test_on_the_ground_the_leg_lifts_the_carriage_by_as_much_as_it_stretches(leg: Robot):
    stretched = reset_pose(leg) * [1.0, 0.5, 0.5]
    actions = np.repeat(np.stack([reset_pose(leg), stretched])[:, None], 150, axis=1)
    low, high = _heights(leg, actions, GROUND)[:, -1]
    assert high - low == pytest.approx(0.28 * (np.cos(0.3) - np.cos(0.6)), abs=0.01)
    assert low > 0.03  # and not the stop but the drives hold it


def test_without_its_drives_the_leg_gives_way(leg: Robot):
    actions = np.tile(reset_pose(leg), (1, 100, 1))
    off = np.zeros((1, 100, len(leg.inputs)))
    assert _heights(leg, actions, GROUND, inputs=off)[0, -1] < 0.005


def test_no_start_is_inside_the_ground(leg: Robot):
    """A stretched leg under a low stop would be 8 cm below the ground: it stands there and does not burst out."""
    straight = np.array([0.0, 0.1, -0.2])
    start = np.full((1, len(leg.channels)), np.nan)
    start[0, [leg.channels.index(f"{j}/position") for j in ("hip_roll", "hip_pitch", "knee")]] = straight
    run = Run(np.tile(straight, (1, 20, 1)), settings=np.array([[GROUND]]), initial=start)
    states = rollout(leg, leg.space.nominal[None], run).states[0, 0]
    speeds = [leg.channels.index(f"{j}/velocity") for j in ("hip_roll", "hip_pitch", "knee")]
    assert np.abs(states[:, speeds]).max() < 1.0
    np.testing.assert_array_equal(states[0, :3], straight)


@pytest.mark.parametrize(
    ("ground", "height"),
    [
        ('pos="0 0 -1" conaffinity="1"', -np.inf),
        ('pos="0 0 0.05" conaffinity="1"', 0.05),
        ('conaffinity="4"', -np.inf),  # which the foot does not touch
        ('quat="1 0.4 0 0" conaffinity="1"', 0.0),  # how high a slope is, nothing tells
    ],
)
def test_the_carriage_is_lifted_onto_a_ground_that_the_leg_can_touch(
    ground: str, height: float, tmp_path: Path
):
    folder = Path(shutil.copytree(load_robot("leg").folder, tmp_path / "leg"))
    text, old = (folder / "model.xml").read_text(), 'type="plane" size="1 1 0.1" conaffinity="1"'
    assert old in text
    (folder / "model.xml").write_text(text.replace(old, f'type="plane" size="1 1 0.1" {ground}'))
    there, start = load_robot(folder), np.array([0.0, 0.1, -0.2])
    known = np.full((1, len(there.channels)), np.nan)
    known[0, [there.channels.index(f"{j}/position") for j in ("hip_roll", "hip_pitch", "knee")]] = start
    run = Run(np.tile(start, (1, 1, 1)), settings=np.array([[GROUND]]), initial=known)
    begun = Arena(there, there.space.nominal[None], run, threads=1).poses(run)[0, 0, 0, 0]
    lowest = GROUND - 0.28 * np.cos(0.1) - 0.015
    assert begun == pytest.approx(max(height - lowest, 0.0), abs=1e-6)
