"""Simulators that drive a whole recording: they reproduce a log that they made, memory and all."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driven_robot import commands, config, logged

import dynreg
from dynreg.compare.simulated import evenly, replayed
from dynreg.data.recording import Episode, Recording
from dynreg.errors import RobotError, SimulationError
from dynreg.session import Session
from dynreg.sim.robot import Robot, load_robot
from dynreg.timed.told import told

DELAYED = {"command_delay": {"delay": 0.06}}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Session:
    session = dynreg.open(tmp_path_factory.mktemp("simulated") / "registry")
    yield session
    session.close()


def error(robot: Robot, truth, log: Recording, longest: float = 2.0) -> np.ndarray:
    """(3,) largest errors of a simulator on all commands of a log."""
    found = told(robot, log, longest=longest)
    out = replayed(robot, truth, "it", log, found)
    return np.abs(out.moved(np.arange(len(found.commands))) - found.moved).max(axis=0)


def test_a_simulator_reproduces_its_own_log(robot: Robot) -> None:
    log = logged(robot, config(robot), [commands(robot, 30, 1), commands(robot, 20, 2)])
    assert (error(robot, config(robot), log) < 1e-9).all()
    assert (error(robot, config(robot), log, longest=0.14) < 1e-9).all()
    assert (error(robot, config(robot, {"yaw_lag": 0.18}), log) > 1e-3).any()


def test_what_a_command_leaves_behind_reaches_into_the_next(robot: Robot) -> None:
    """A delay of three rows: half of a short command is still the one before."""
    log = logged(robot, config(robot, effects=DELAYED), [commands(robot, 40, 3, (0.1, 0.2))])
    assert (error(robot, config(robot, effects=DELAYED), log) < 1e-9).all()
    assert error(robot, config(robot), log)[1] > 0.005


def test_rows_that_come_unevenly_are_put_on_a_grid(robot: Robot) -> None:
    """A row where a command begins, and none in between."""
    actions = commands(robot, 40, 4)
    log = logged(robot, config(robot), [actions])
    (whole,) = log.episodes
    rows = np.flatnonzero(np.any(np.diff(actions, axis=0, prepend=np.nan), axis=1))
    rows = np.append(rows, len(actions))
    sparse = Recording(log.channels, (Episode("run", whole.time[rows], whole.values[rows]),))
    assert len(told(robot, sparse).commands) == 40
    assert (error(robot, config(robot), sparse) < 1e-9).all()
    late = Recording(log.channels, (Episode("run", whole.time[rows] + 3.003 * 1.0, whole.values[rows]),))
    assert (error(robot, config(robot), late) < 1e-9).all()
    grid = evenly(robot, sparse).episodes[0].time
    assert np.diff(grid) == pytest.approx(robot.file.robot.timestep) and grid[-1] >= whole.time[-1] - 1e-9


def test_a_channel_that_comes_late_does_not_take_commands_away(robot: Robot) -> None:
    log = logged(robot, config(robot), [commands(robot, 30, 5)])
    (episode,) = log.episodes
    values = episode.values.copy()
    values[:40, log.names.index("left_wheel/velocity")] = np.nan
    values[1::2, log.names.index("base/x")] = np.nan  # a camera half as quick: some commands have no pose
    late = Recording(log.channels, (Episode("run", episode.time, values),))
    even = evenly(robot, late).episodes[0]
    unknown = [log.names.index("left_wheel/velocity")]  # first seen 0.8 s later: then it was another one
    assert np.flatnonzero(np.isnan(even.values[0])).tolist() == unknown
    assert np.array_equal(even.time, episode.time)
    found = told(robot, late)
    assert len(found.commands) + found.left_out == 30 and 5 < found.left_out < 25 and found.begin[0] < 0.8
    assert error(robot, config(robot), late)[1] < 0.01


def test_a_channel_starts_with_a_value_of_the_first_tenth_of_a_second(robot: Robot) -> None:
    log = logged(robot, config(robot), [commands(robot, 10, 5)])
    (episode,) = log.episodes
    column = log.names.index("left_wheel/velocity")
    for missing, begins in ((0, 0), (5, 5), (6, None)):
        values = episode.values.copy()
        values[:missing, column] = np.nan
        first = (
            evenly(robot, Recording(log.channels, (replace(episode, values=values),))).episodes[0].values[0]
        )
        assert np.array_equal(
            first[column], np.nan if begins is None else episode.values[begins, column], equal_nan=True
        )


def test_a_base_that_is_told_its_speed_and_yaw_rate(tmp_path: Path) -> None:
    """A Husky with a pose, its wheels 2 m apart by agreement; the closed form does not know its gains and lags."""
    folder = tmp_path / "husky"
    shutil.copytree(load_robot("husky").folder, folder, ignore=shutil.ignore_patterns("maps"))
    pose = "".join(
        f'\n[[channels]]\nname = "base/{name}"\nunit = "{unit}"\nnoise = 0.001\n'
        for name, unit in (("x", "m"), ("y", "m"), ("yaw", "rad"))
    )
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    (folder / "robot.toml").write_text(text.replace("\n[[inputs]]", pose + "\n[[inputs]]"), encoding="utf-8")
    husky = load_robot(folder)
    log = logged(husky, config(husky), [commands(husky, 70, 6)])
    found = told(husky, log)
    speed, yaw_rate = log.columns(["base/speed_command", "base/yaw_rate_command"])
    begins = log.episodes[0].values[np.searchsorted(log.episodes[0].time, found.begin - 1e-9)]
    assert 0.5 * (found.commands.left + found.commands.right) == pytest.approx(begins[:, speed])
    assert (found.commands.right - found.commands.left) / found.track == pytest.approx(begins[:, yaw_rate])
    assert (error(husky, config(husky), log) < 1e-9).all()
    with dynreg.open(tmp_path / "registry") as session:
        session.ingest(log, folder, name="yard")
        result = session.compare("yard", models=["kinematic"], simulators=["nominal"]).commands
        assert result.best == "nominal" and result.track == 2.0
        assert result.errors.models["kinematic"]["dtheta"].mean > 2.0
    with pytest.raises(RobotError, match="has no pose of a base"):
        replayed(load_robot("husky"), config(load_robot("husky")), "blind", log, found)


def test_a_simulator_that_diverges_is_named(robot: Robot) -> None:
    log = logged(robot, config(robot), [commands(robot, 20, 1)])
    with pytest.raises(SimulationError, match="simulator 'wild' diverges"):
        replayed(robot, config(robot, {"track": float("nan")}), "wild", log, told(robot, log))
