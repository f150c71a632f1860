"""A robot on feet is replayed from where it stands and looks at first, and its heading may pass half a turn."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.replay.cut import windows
from dynreg.replay.standing_place import from_the_start
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.config import SimConfig
from dynreg.sim.engines import rollout
from dynreg.sim.layout import headed, layout_of
from dynreg.sim.live import LiveSimulator
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

STEPS = 30


def placed(robot: Robot) -> Robot:
    """It begins where the log says."""
    table = robot.file.reset.model_copy(update={"base": "measured"})
    return replace(robot, file=robot.file.model_copy(update={"reset": table}))


def turned(robot: Robot, tmp_path: Path) -> Robot:
    """Its keyframe has the base elsewhere, looking 2 rad to the left."""
    folder = Path(shutil.copytree(robot.folder, tmp_path / "quadruped"))
    text, at = (folder / "model.xml").read_text(), 'qpos="0 0 0.24 1 0 0 0 '
    assert at in text
    there = f'qpos="1.5 -0.7 0.24 {np.cos(1.0)} 0 0 {np.sin(1.0)} '
    (folder / "model.xml").write_text(text.replace(at, there))
    return load_robot(folder)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("quadruped")


@pytest.fixture(scope="module")
def run(robot: Robot) -> Run:
    """Commands by which it stumbles on the spot."""
    t = np.arange(STEPS) / robot.rate
    phase = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, len(robot.actions))
    return Run(0.2 * np.sin(4.0 * np.pi * t[:, None] + phase)[None], period=1.0 / robot.rate)


def column(robot: Robot, quantity: str) -> int:
    return robot.channels.index(f"base/{quantity}")


def logged(robot: Robot, run: Run, states: np.ndarray) -> Recording:
    """What a log of states (T+1, S) under the commands holds."""
    table = np.hstack([states, np.vstack([run.actions[0], run.actions[0, -1:]])])
    channels = tuple(Channel(c.name, c.unit) for c in (*robot.file.channels, *robot.file.actions))
    return Recording(channels, (Episode("one", np.arange(len(states)) / robot.rate, table),))


def missed(robot: Robot, recording: Recording) -> float:
    """The replay error of the nominal simulator."""
    cut = windows(robot, recording)
    values = robot.space.nominal[None]
    return float(errors(Replayer(robot, cut).residuals(values, np.arange(len(cut)))).max())


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0, 9.0])
def test_the_true_simulator_leaves_nothing_whichever_way_the_robot_looked(
    robot: Robot, run: Run, heading: float
) -> None:
    states = rollout(robot, robot.space.nominal[None], run).states[0, 0]
    turned = states.copy()
    turned[:, column(robot, "yaw")] += heading
    assert missed(robot, logged(robot, run, turned)) < 1e-3
    assert missed(robot, logged(robot, run, states + 0.1 * np.arange(len(states))[:, None])) > 0.1


def test_what_begins_at_the_origin_but_for_noise_stays_as_it_was_measured(robot: Robot) -> None:
    rows = np.random.default_rng(1).normal(size=(2, 5, len(robot.channels)))
    yaw = column(robot, "yaw")
    rows[0, 0, yaw], rows[1, 0, yaw] = 2.0 * robot.sensor_noise[yaw], 1.0
    out = from_the_start(robot, rows)
    assert (out[0] == rows[0]).all() and out[1, 0, yaw] == 0.0
    others = np.delete(np.arange(len(robot.channels)), yaw)
    assert (out[..., others] == rows[..., others]).all()
    assert from_the_start(placed(robot), rows) is rows


@pytest.mark.parametrize("heading", [4.0, 3.0, -9.0])
def test_a_heading_goes_on_beyond_half_a_turn_from_the_turn_in_which_it_was_measured(
    robot: Robot, run: Run, heading: float
) -> None:
    measured, yaw = placed(robot), column(robot, "yaw")
    start = rollout(robot, robot.space.nominal[None], run).states[0, :, 0].copy()
    start[:, column(robot, "wz")] = 6.0
    start[:, yaw] = heading
    states = rollout(measured, robot.space.nominal[None], replace(run, initial=start)).states[0, 0]
    assert states[0, yaw] == pytest.approx(heading)
    assert states[-1, yaw] > heading + 0.4 and np.abs(np.diff(states[:, yaw])).max() < 0.3
    live = LiveSimulator(measured, SimConfig.of(measured, measured.space.nominal), period=run.period)
    stepped = [live.reset(start[0]), *map(live.step, run.actions[0])]
    assert np.array_equal(np.array(stepped), states)


def test_the_half_turn_that_a_base_shows_as_it_pitches_through_the_vertical_is_no_turn(robot: Robot) -> None:
    """What follows in the log and in the simulation is the heading that it had before."""
    told = np.array([3.1, -3.1, 0.0, -3.15, 0.0, 3.1])
    states = np.zeros((1, len(told), len(robot.channels)))
    states[0, :, column(robot, "yaw")] = told
    headed(layout_of(robot), states, None)
    ahead = told + np.array([0, 1, 1, 1, 1, 1]) * 2.0 * np.pi
    assert states[0, :, column(robot, "yaw")] == pytest.approx(ahead)


def test_a_horizon_cuts_no_window_from_the_middle_where_no_log_places_the_base(
    robot: Robot, run: Run
) -> None:
    """The robot neither stood nor was at rest there, as the keyframe's pose is."""
    states = rollout(robot, robot.space.nominal[None], run).states[0, 0]
    table = robot.file.replay.model_copy(update={"horizon": 0.25})
    short = replace(robot, file=robot.file.model_copy(update={"replay": table}))
    assert windows(short, logged(robot, run, states)).rows.tolist() == [[0, 10]]
    assert len(windows(placed(short), logged(robot, run, states))) == 3


def test_a_keyframe_away_from_the_origin_is_where_replays_begin(
    robot: Robot, run: Run, tmp_path: Path
) -> None:
    moved = turned(robot, tmp_path)
    states = rollout(robot, robot.space.nominal[None], run).states[0, 0]
    begun = from_the_start(moved, states[None])[0]
    assert begun[0, column(robot, "yaw")] == pytest.approx(2.0)
    others = np.delete(np.arange(len(robot.channels)), column(robot, "yaw"))
    assert (begun[:, others] == states[:, others]).all()
    again = rollout(moved, moved.space.nominal[None], run).states[0, 0]
    place = [column(robot, name) for name in ("roll", "pitch", "yaw")]
    assert again[0, place] == pytest.approx(states[0, place] + [0.0, 0.0, 2.0], abs=1e-4)
    assert missed(moved, logged(robot, run, again)) < 1e-3
    again[:, column(robot, "yaw")] -= 2.0  # as a log that begins at 0
    assert missed(moved, logged(robot, run, again)) < 1e-3


def test_a_log_is_moved_and_turned_to_the_keyframe_s_place(robot: Robot, tmp_path: Path) -> None:
    told = [
        c.model_copy(update={"name": f"base/{q}", "unit": "m"}) for c in robot.file.channels[:1] for q in "xy"
    ]
    there = replace(
        turned(robot, tmp_path),
        file=robot.file.model_copy(update={"channels": [*told, *robot.file.channels]}),
    )
    rows = np.zeros((2, 3, len(there.channels)))
    yaw = there.channels.index("base/yaw")
    rows[0, :, 1], rows[0, :, yaw] = [4.0, 5.0, 4.0], np.pi / 2  # it goes ahead
    rows[1, :, :2] = [[1.5, -0.7], [np.nan, np.nan], [2.5, 0.0]]
    rows[1, 0, yaw] = 2.0
    out = from_the_start(there, rows)
    start = np.array([1.5, -0.7])
    assert out[0, :, :2] == pytest.approx(start + np.outer([0, 1, 0], [np.cos(2.0), np.sin(2.0)]))
    assert out[0, :, yaw] == pytest.approx(2.0)
    assert np.array_equal(out[1], rows[1], equal_nan=True)
