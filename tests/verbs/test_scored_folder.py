"""The folder of trials that a person scores: what it asks, what it reads, and what it refuses."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.adapt.tried import Rules
from dynreg.errors import UsageError
from dynreg.gait.tasks import kinds
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim.robot import Robot

TINY = Rules(
    iterations=1, first=2, later=1, gaits=4, stand=2, repeats=2, turns=1, simulators=2, variations=2, steps=1
)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynreg.verbs.trial_folder.QUIET", 0.0)
    monkeypatch.setattr("dynreg.verbs.trial_folder.EVERY", 0.01)


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Session]:
    with dynreg.open(tmp_path / "registry") as made:
        yield made


class Person:
    """Answers what is asked with what `writes` (folder, name) puts there, and keeps all lines."""

    def __init__(self, folder: Path, writes: Callable[[Path, str], None], after: int = 100):
        self.folder, self.writes, self.after = folder, writes, after
        self.lines, self.asked = [], []

    def __call__(self, line: str) -> None:
        self.lines.append(line)
        if " on the robot (" in line:
            self.asked.append(line)
            if len(self.asked) > self.after:
                raise KeyboardInterrupt
            self.writes(self.folder, f"trial_{len(self.asked)}")


def measures(folder: Path, name: str) -> None:
    (folder / f"{name}_score.txt").write_text("0.2")


def calibrated(opened: Session, own: Robot, folder: Path, say, **told) -> Calibration:
    given = {"rules": TINY, "seed": 3, "threads": 1, "trials": 3, **told}
    return opened.calibrate(own, method="btr", robot_door=folder, say=say, **given)


def interrupted(opened: Session, own: Robot, folder: Path, after: int, **told) -> None:
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, own, folder, Person(folder, measures, after), **told)


@pytest.mark.parametrize("answer", ["trial_1_score.txt", "trial_1_log.csv"])
@pytest.mark.parametrize("resume", [False, True])
def test_an_answer_to_commands_that_were_never_written_is_refused(
    opened: Session, brief: Robot, tmp_path: Path, answer: str, resume: bool
) -> None:
    folder = tmp_path / "trials"
    folder.mkdir()
    (folder / answer).write_text("0.2")
    with pytest.raises(
        UsageError,
        match=f"{answer}' answers trial_1.csv, which was never written.* remove it, or name a new folder",
    ):
        calibrated(opened, brief, folder, print, resume=resume)
    assert [path.name for path in folder.iterdir()] == [answer]


def test_an_answer_that_comes_before_its_trial_is_refused(
    opened: Session, brief: Robot, tmp_path: Path
) -> None:
    def writes_ahead(folder: Path, name: str) -> None:
        measures(folder, name)
        measures(folder, "trial_2")

    folder = tmp_path / "trials"
    with pytest.raises(
        UsageError,
        match=r"trial_2_score.txt' answers .*; remove it; then the same command with --resume goes on",
    ):
        calibrated(opened, brief, folder, Person(folder, writes_ahead))
    (folder / "trial_2_score.txt").unlink()

    def later(folder: Path, name: str) -> None:
        measures(folder, f"trial_{int(name[6:]) + 1}")

    person = Person(folder, later)
    assert calibrated(opened, brief, folder, person, resume=True).cost.trials == 3
    assert not any("trial 1 of" in line for line in person.asked), "the first trial is kept"


def test_a_robot_without_a_task_lacks_what_trials_need(opened: Session, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="method 'btr' needs a task to score: robot 'servo_pendulum' has no"):
        calibrated(opened, "servo_pendulum", tmp_path / "trials", print)
    assert not (tmp_path / "trials").exists()


def test_a_folder_of_another_question_is_refused(opened: Session, brief: Robot, tmp_path: Path) -> None:
    folder = tmp_path / "trials"
    calibrated(opened, brief, folder, Person(folder, measures))
    for told, says in (
        ({"task": "turn"}, "task 'forward'"),
        ({"seed": 4}, "seed 3"),
        ({"goal": 9.0}, "no goal"),
        ({"search": "cma"}, "search 'roulette'"),
    ):
        for resume in (False, True):
            with pytest.raises(UsageError, match=f"are of {says}.* name a new folder"):
                calibrated(opened, brief, folder, print, resume=resume, **told)
    (folder / "trials.json").unlink()
    with pytest.raises(UsageError, match=r"no trials.json that says of which task"):
        calibrated(opened, brief, folder, print, resume=True, trials=9)


def test_answered_trials_are_taken_with_resume_alone_and_that_is_said_first(
    opened: Session, brief: Robot, tmp_path: Path
) -> None:
    folder, person = tmp_path / "trials", Person(tmp_path / "trials", measures)
    calibrated(opened, brief, folder, person)
    with pytest.raises(UsageError, match="has answers already, to 3 trials.* give --resume to take them"):
        calibrated(opened, brief, folder, print)
    person.lines.clear()
    found = calibrated(opened, brief, folder, person, resume=True, trials=4)
    assert person.lines[0] == f"3 trials taken from {folder}, and not played again"
    assert len(person.asked) == 4 and found.on_robot.scores() == [0.2] * 4


def test_an_interrupted_wait_goes_on_as_the_prompt_says(
    opened: Session, brief: Robot, tmp_path: Path
) -> None:
    folder = tmp_path / "trials"
    interrupted(opened, brief, folder, after=0)
    measures(folder, "trial_1")
    with pytest.raises(UsageError, match="has answers already, to 1 trial;"):
        calibrated(opened, brief, folder, print)
    second = Person(folder, measures)
    second.asked.append("trial 1")
    calibrated(opened, brief, folder, second, resume=True)
    assert [line.split(" of ")[0] for line in second.asked] == ["trial 1", "trial 2", "trial 3"]
    assert "Ctrl-C ends the wait: the same command with --resume goes on" in second.lines


@pytest.mark.parametrize("typo", ["1.2 meters I think", "0,82", "0.3\n0.4"])
def test_a_typo_is_told_and_waited_for_until_it_is_corrected(
    opened: Session, brief: Robot, tmp_path: Path, typo: str
) -> None:
    folder, said = tmp_path / "trials", []

    def corrects(line: str) -> None:
        said.append(line)
        if " on the robot (" in line:
            (folder / "trial_1_score.txt").write_text(typo)
        elif "it is waited for" in line:
            (folder / "trial_1_score.txt").write_text("0.4 m\n")

    found = calibrated(opened, brief, folder, corrects, trials=1)
    told = [line for line in said if "it is waited for" in line]
    assert len(told) == 1 and "says" in told[0] and "a number with a decimal point" in told[0]
    assert found.on_robot.scores() == [0.4] and said[-1] == "trial 1: 0.4 m, by trial_1_score.txt"


def test_a_log_that_cannot_be_read_is_told_and_a_score_serves_in_its_place(
    opened: Session, brief: Robot, tmp_path: Path
) -> None:
    folder, said = tmp_path / "trials", []

    def answers(line: str) -> None:
        said.append(line)
        if " on the robot (" in line:
            (folder / "trial_1_log.csv").write_text("time,nothing\n0,0\n1,0\n")
        elif "it is waited for" in line:
            measures(folder, "trial_1")

    found = calibrated(opened, brief, folder, answers, trials=1)
    assert sum("correct trial_1_log.csv" in line for line in said) == 1
    assert found.on_robot.scores() == [0.2]


def test_the_prompt_says_what_to_measure_once_then_one_line_a_trial(
    opened: Session, brief: Robot, tmp_path: Path
) -> None:
    folder = tmp_path / "trials"
    person = Person(folder, lambda folder, name: (folder / f"{name}_score.txt").write_text("0.1 rad"))
    calibrated(opened, brief, folder, person, task="turn")
    first = person.lines[:3]
    assert first[0].startswith("task 'turn': Radians turned to the left") and "side = 1" in first[0]
    assert "[rad]" in first[1] and "a robot that does not stand at the end of the trial fell" in first[1]
    assert len(person.lines) == 3 + 2 * 3, "a question and what was read, for each trial"
    tries = [line.partition(": play")[0] for line in person.asked]
    assert tries == [f"trial {n} of 3 (gait {g}, try {t})" for n, g, t in ((1, 1, 1), (2, 1, 2), (3, 2, 1))]
    assert all(len(line.replace(str(folder), "")) < 110 for line in person.asked)
    assert person.lines[-1] == "trial 3: 0.1 rad, by trial_3_score.txt"


def test_every_kind_of_task_says_what_it_scores_alone() -> None:
    for kind in kinds().values():
        assert kind.__doc__ and "the same" not in kind.__doc__.lower()


def test_a_fall_is_read_as_one(opened: Session, brief: Robot, tmp_path: Path) -> None:
    folder = tmp_path / "trials"

    def falls_once(folder: Path, name: str) -> None:
        (folder / f"{name}_score.txt").write_text("Fell" if name == "trial_1" else "0.3")

    person = Person(folder, falls_once)
    found = calibrated(opened, brief, folder, person)
    assert found.on_robot.scores()[0] is None and np.isfinite(found.on_robot.scores()[1])
    assert "trial 1: fell, by trial_1_score.txt" in person.lines


def test_of_two_logs_of_a_trial_neither_is_taken(opened: Session, brief: Robot, tmp_path: Path) -> None:
    folder, said = tmp_path / "trials", []

    def answers(line: str) -> None:
        said.append(line)
        if " on the robot (" in line:
            for name in ("trial_1_log.csv", "trial_1_log (1).csv"):
                (folder / name).write_text("time,nothing\n0,0\n1,0\n")
        elif "would all be the log of trial_1" in line:
            (folder / "trial_1_log (1).csv").unlink()
        elif "correct trial_1_log.csv" in line:
            measures(folder, "trial_1")

    found = calibrated(opened, brief, folder, answers, trials=1)
    assert sum("trial_1_log (1).csv, trial_1_log.csv would all be" in line for line in said) == 1
    assert not any("correct trial_1_log (1).csv" in line for line in said), "neither was read"
    assert found.on_robot.scores() == [0.2]
