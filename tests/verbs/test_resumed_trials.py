"""A calibration by trials goes on after a trial went wrong: what the robot did counts, and is not done again."""

import re
from pathlib import Path

import pytest

import dynreg
from dynreg.adapt.tried import Rules
from dynreg.errors import LogError, UsageError
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim.robot import Robot

TINY = Rules(
    iterations=1, first=1, gaits=4, stand=2, repeats=2, turns=1, simulators=2, variations=2, steps=1, lost=0.9
)


def calibrated(opened: Session, robot: Robot, door, **told) -> Calibration:
    given = {"rules": TINY, "seed": 3, "threads": 1, "say": lambda _: None, "trials": 4, **told}
    return opened.calibrate(robot, method="btr", robot_door=door, **given)


def test_a_trial_that_failed_is_paid_for_by_every_later_run(brief: Robot, tmp_path: Path) -> None:
    names = []

    def door(actions, rate: float, name: str) -> float:
        names.append(name)
        if len(names) == 3:
            raise LogError("no log", expected="one", do="log it")
        return 1.0

    with dynreg.open(tmp_path / "registry") as opened:
        with pytest.raises(LogError, match="no log"):
            calibrated(opened, brief, door)
        found = calibrated(opened, brief, door, resume=True)
    assert names == ["trial_1", "trial_2", "trial_3", "trial_4"] and found.cost.trials == 4
    assert found.cost.trial_seconds == pytest.approx(4.0)
    assert [n for one in found.on_robot.tried for n in one.trials] == [1, 2, 4]


def test_a_trial_in_a_folder_whose_score_is_mended_is_taken_back(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynreg.verbs.trial_folder.QUIET", 0.0)
    monkeypatch.setattr("dynreg.verbs.trial_folder.EVERY", 0.01)
    folder, scores = tmp_path / "trials", ["0.1", "0.2", "about a metre", "0.4"]

    def person(line: str) -> None:
        if asked := re.match(r"trial (\d+) of", line):
            (folder / f"trial_{asked[1]}_score.txt").write_text(scores[int(asked[1]) - 1], encoding="utf-8")
        elif "about a metre" in line:
            raise KeyboardInterrupt

    with dynreg.open(tmp_path / "registry") as opened:
        with pytest.raises(KeyboardInterrupt):
            calibrated(opened, brief, folder, say=person)
        (folder / "trial_3_score.txt").write_text("0.3", encoding="utf-8")
        found = calibrated(opened, brief, folder, resume=True, say=person)
    assert found.on_robot.scores() == [0.1, 0.2, 0.3, 0.4] and found.cost.trials == 4
    assert sorted(path.name for path in folder.glob("trial_*.csv")) == [f"trial_{i}.csv" for i in range(1, 5)]


def test_the_gait_that_is_told_and_stored_is_the_one_that_was_tried_again(
    brief: Robot, tmp_path: Path
) -> None:
    names = []

    def door(actions, rate: float, name: str) -> float:
        """The fifth, which is the first small step, is lucky."""
        names.append(name)
        return 9.0 if len(names) == 5 else 1.0 / len(names)

    with dynreg.open(tmp_path / "registry") as opened:
        found = calibrated(opened, brief, door, trials=12)
    told = found.on_robot
    assert 9.0 in told.scores() and told.best == 1 and told.tried[0].score == pytest.approx(0.75)
    assert told.gait != {} and found.cost.trials == len(names) == 4 + 2 + 2


def test_an_answer_that_the_run_has_gone_on_with_stays(
    brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynreg.verbs.trial_folder.QUIET", 0.0)
    monkeypatch.setattr("dynreg.verbs.trial_folder.EVERY", 0.01)
    folder = tmp_path / "trials"

    def person(line: str) -> None:
        if asked := re.match(r"trial (\d+) of", line):
            if asked[1] == "3":
                raise KeyboardInterrupt
            (folder / f"trial_{asked[1]}_score.txt").write_text("8.2", encoding="utf-8")

    with dynreg.open(tmp_path / "registry") as opened:
        with pytest.raises(KeyboardInterrupt):
            calibrated(opened, brief, folder, say=person)
        (folder / "trial_2_score.txt").write_text("0.82", encoding="utf-8")
        with pytest.raises(UsageError, match=r"says 0.82, and .* said 8.2; .* write 8.2 there again"):
            calibrated(opened, brief, folder, resume=True, say=person)
