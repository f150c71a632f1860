"""`calibrate --method btr` where trials tell more than a score: logs in a folder, and a robot that counts itself."""

from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.adapt.tried import Rules
from dynreg.data.recording import Recording
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import Robot

TINY = Rules(
    iterations=1, first=2, later=1, gaits=4, stand=2, repeats=2, turns=1, simulators=2, variations=2, steps=1
)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynreg.sim.real.FINER", 2)
    monkeypatch.setattr("dynreg.verbs.trial_folder.QUIET", 0.0)
    monkeypatch.setattr("dynreg.verbs.trial_folder.EVERY", 0.01)


def robot_of(brief: Robot) -> SimulatedRobot:
    return SimulatedRobot(brief, brief.space.nominal, seed=5, threads=1)


def calibrated(opened: Session, brief: Robot, door, **told) -> Calibration:
    return opened.calibrate(brief, method="btr", robot_door=door, rules=TINY, seed=3, threads=1, **told)


def write_log(path: Path, log: Recording) -> None:
    (episode,) = log.episodes
    rows = np.concatenate([episode.time[:, None], episode.values], axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(["time", *log.names]), comments="", fmt="%.17g")


def test_logs_in_a_folder_score_as_the_robot_that_they_are_of(brief: Robot, tmp_path: Path) -> None:
    folder, real, names = tmp_path / "trials", robot_of(brief), []

    def operator(line: str) -> None:
        """Plays each table that is asked for."""
        name = f"trial_{len(names) + 1}"
        if f"{name}.csv on the robot" not in line:
            return
        told = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)
        write_log(folder / f"{name}_log.csv", real.run(told[:, 1:], brief.rate).recording)
        names.append(name)

    with dynreg.open(tmp_path / "registry") as opened:
        by_logs = calibrated(opened, brief, folder, trials=3, say=operator)
        alone = calibrated(opened, brief, robot_of(brief), trials=3)
    assert names == ["trial_1", "trial_2", "trial_3"]
    told, expected = by_logs.on_robot.scores(), alone.on_robot.scores()
    assert None not in expected and max(expected) > 0.02
    assert told == pytest.approx(expected, abs=0.02)


def test_a_robot_that_counts_itself_is_told_of_an_interrupted_run(brief: Robot, tmp_path: Path) -> None:
    first, second = robot_of(brief), robot_of(brief)
    plays = first.play

    def play(actions: np.ndarray, rate: float, name: str):
        if name == "trial_3":
            raise KeyboardInterrupt
        return plays(actions, rate, name)

    first.play = play
    with pytest.raises(KeyboardInterrupt), dynreg.open(tmp_path / "registry") as opened:
        calibrated(opened, brief, first, trials=5)
    with dynreg.open(tmp_path / "registry") as opened:
        found = calibrated(opened, brief, second, trials=5, resume=True)
    assert (second.spent.trials, second.spent.falls) == (found.cost.trials, found.cost.falls)
    assert second.spent.trials == 5 and second.spent.seconds == pytest.approx(found.cost.trial_seconds)
