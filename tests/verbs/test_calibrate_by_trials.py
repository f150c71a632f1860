"""`calibrate --method btr`: a robot in place of a recording, through a session, a folder and the command line."""

import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynreg
from dynreg.adapt.tried import Rules
from dynreg.errors import Assumed, CorruptError, DynregError, LogError, NoMatchError, UsageError
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import task_of
from dynreg.methods import by_reality
from dynreg.report.html import page
from dynreg.report.tables import render
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim import versions
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.scored_folder import ScoredFolder, read_score

TINY = Rules(
    iterations=2, first=2, later=1, gaits=4, stand=2, repeats=2, turns=2, simulators=3, variations=2, steps=1
)


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Session]:
    with dynreg.open(tmp_path / "registry") as made:
        yield made


class Door:
    """A robot that scores how far its joints are sent, and breaks after some trials."""

    def __init__(self, breaks: int | None = None, falls: bool = False):
        self.breaks, self.falls, self.names = breaks, falls, []

    def __call__(self, actions: np.ndarray, rate: float, name: str) -> float | None:
        if len(self.names) == self.breaks:
            raise KeyboardInterrupt
        self.names.append(name)
        return None if self.falls else float(np.ptp(actions, axis=0).mean())


def calibrated(opened: Session, own: Robot | str, door, **told) -> Calibration:
    given = {"rules": TINY, "seed": 3, "threads": 1, "say": lambda _: None, **told}
    return opened.calibrate(own, method="btr", robot_door=door, **given)


@pytest.fixture(scope="module")
def whole(brief: Robot, tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """What the usual run finds, in a registry of its own."""
    with dynreg.open(tmp_path_factory.mktemp("whole") / "registry") as made:
        return calibrated(made, brief, Door())


def told_by(found: Calibration) -> dict:
    """All but what differs from run to run."""
    document = found.to_dict()
    cost = {
        k: v for k, v in document["cost"].items() if k in ("trials", "trial_seconds", "falls", "discarded")
    }
    document["on_robot"].pop("document")  # it holds a wall time
    return document | {"cost": cost}


def test_a_simulated_robot_is_calibrated_by_its_scores_alone(
    opened: Session, brief: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynreg.sim.real.FINER", 2)
    space = brief.space
    hidden = space.from_unit(np.clip(space.to_unit(space.nominal) + 0.1, 0.0, 1.0))
    real = SimulatedRobot(brief, hidden, seed=5, threads=1)
    found = calibrated(opened, brief, real, rules=Rules(**{**vars(TINY), "iterations": 1}))
    assert found.recording is None and found.train_error is None and found.ended == "iterations"
    assert (found.cost.trials, found.cost.falls) == (real.spent.trials, real.spent.falls)
    assert found.cost.trial_seconds == pytest.approx(real.spent.seconds)
    start, adapted = found.versions
    assert start.stage == "start" and adapted.parent == start.simulator
    assert adapted.stage == "iteration 1" and adapted.after <= adapted.before and adapted.unit == "m"
    kept = opened.registry.simulator(adapted.simulator)
    assert kept["lineage"]["trials"] == [*adapted.trials] and kept["lineage"]["made_by"] == "calibrate btr"
    assert found.simulator == adapted.simulator and kept["robot"] == brief.hash
    assert opened.result("@last") == found
    listed = next(i for i in opened.list("result").items if i.name == "calibration").detail
    best = found.on_robot.tried[found.on_robot.best - 1]
    assert (listed["trials"], listed["score"]) == (found.cost.trials, pytest.approx(best.score, abs=1e-4))
    gait = opened.result(found.on_robot.document)
    told = next(i for i in opened.list("result").items if i.name == "gait").detail
    assert told["expected_score"] == pytest.approx(gait.expected.median, abs=1e-4)
    (note,) = gait.notes
    assert f"{best.score:.4g} m, the mean of {len(best.trials)} of {found.cost.trials} trials there" in note
    assert f"{found.cost.falls} ended with a fall" in note
    assert Calibration.model_validate(found.to_dict()) == found
    text = page(found)
    assert "trials on the robot" in text and "difference of simulated and real scores" in text
    assert render(found) is not None and found.tables()["robot"]


def test_the_gait_can_be_played_and_begun_with(opened: Session, brief: Robot, tmp_path: Path) -> None:
    found = calibrated(opened, brief, Door())
    gait = opened.export_gait(found.on_robot.document, tmp_path / "gait.py", "python")
    genes = {name: gene.value for name, gene in gait.genes.items()}
    assert genes == pytest.approx(found.on_robot.gait) and gait.method == "btr" and "None" not in str(gait)
    again = calibrated(opened, brief, Door(), gait=found.on_robot.document, seed=4)
    best = found.on_robot.tried[found.on_robot.best - 1]
    assert again.on_robot.tried[0].score == pytest.approx(best.score, rel=1e-6)
    assert again.on_robot.tried[0].simulated is None, "it is tried first"
    later = calibrated(opened, brief, Door(), start=found.simulator, seed=5)
    assert later.versions[0].parent == found.simulator


def test_an_exported_calibration_brings_its_gait_and_can_lose_it(
    opened: Session, brief: Robot, tmp_path: Path
) -> None:
    found = calibrated(opened, brief, Door(), trials=4)
    calibration = opened.registry.latest("calibration").id
    opened.export([calibration], tmp_path / "copy")
    with dynreg.open(tmp_path / "copy", create=False) as copy:
        assert copy.result(found.on_robot.document) == opened.result(found.on_robot.document)
        assert copy.result(calibration) == found
        gait = copy.export_gait(found.on_robot.document, tmp_path / "gait.py", "python")
        assert {name: gene.value for name, gene in gait.genes.items()} == pytest.approx(found.on_robot.gait)
        assert [i.id for i in copy.remove([found.on_robot.document]).items] == [found.on_robot.document]
        assert copy.result(calibration) == found, "trials on a robot cannot be had again"
        copy.export([calibration], tmp_path / "without")


def test_the_stored_gait_costs_what_it_took_and_its_runs_are_counted(
    opened: Session, brief: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, took = time.perf_counter, 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: own() + took)

    def door(actions: np.ndarray, rate: float, name: str) -> float:
        nonlocal took
        took += 1000.0
        return 0.1

    found = calibrated(opened, brief, door, trials=1)
    gait = opened.result(found.on_robot.document)
    sought = found.cost.rollouts - gait.cost.rollouts
    assert 0 < sought <= TINY.first * TINY.gaits and gait.cost.rollouts > 1
    assert found.cost.simulated_seconds == pytest.approx(found.cost.rollouts * task_of(brief).seconds)
    assert gait.cost.seconds <= found.cost.seconds - 1000.0, "not what the robot took"


def test_the_same_bytes_on_any_threads(opened: Session, brief: Robot, whole: Calibration) -> None:
    assert told_by(whole) == told_by(calibrated(opened, brief, Door(), threads=2))


@pytest.mark.parametrize("breaks", [1, 6])
def test_an_interrupted_run_goes_on_and_plays_no_trial_twice(
    opened: Session, brief: Robot, breaks: int, whole: Calibration
) -> None:
    first, second = Door(breaks), Door()
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, first)
    with pytest.raises(UsageError, match="no trials of an interrupted run.*give its settings and seed"):
        calibrated(opened, brief, Door(), seed=9, resume=True)
    found = calibrated(opened, brief, second, resume=True)
    assert found.on_robot.scores() == whole.on_robot.scores()
    assert found.parameters == whole.parameters and found.on_robot.gait == whole.on_robot.gait
    names = [f"trial_{i}" for i in range(1, whole.cost.trials + 2) if i != breaks + 1]
    assert [*first.names, *second.names] == names, "the robot may have moved in the one that was interrupted"
    assert found.cost.trials == whole.cost.trials + 1
    assert found.cost.lost == 1 and whole.cost.lost == 0 and "1 trial without an outcome" in page(found)
    assert 0 < found.cost.resumed < found.cost.rollouts == whole.cost.rollouts
    assert found.cost.simulated_seconds == pytest.approx(whole.cost.simulated_seconds)


def test_trials_of_an_interrupted_run_are_not_lost_where_resume_is_forgotten(
    opened: Session, brief: Robot
) -> None:
    first, door = Door(3), Door()
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, first)
    with pytest.raises(
        UsageError, match=r"the trials of .* \([34]\) would be lost.*--resume, or another --seed"
    ):
        calibrated(opened, brief, door)
    calibrated(opened, brief, Door(), seed=4, trials=2)
    assert not door.names, "nothing moved"
    calibrated(opened, brief, door, resume=True, trials=5)
    assert door.names[-1] == "trial_5"
    calibrated(opened, brief, door, trials=2)


def test_trials_of_one_python_robot_are_not_taken_for_those_of_another(opened: Session, brief: Robot) -> None:
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, Door(3))
    with pytest.raises(UsageError, match="no trials of an interrupted run"):
        calibrated(opened, brief, lambda *_: 5.0, resume=True)


def test_a_robot_with_other_commands_is_refused_before_a_trial_is_begun(
    opened: Session, brief: Robot
) -> None:
    other = SimulatedRobot(load_robot("leg"), load_robot("leg").space.nominal, threads=1)
    with pytest.raises(UsageError, match="a robot to try with the commands .*knee"):
        calibrated(opened, brief, other)
    calibrated(opened, brief, Door(), trials=2)


def test_a_gait_past_the_robots_limits_is_refused_before_a_trial(
    opened: Session, brief: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A family of a plugin may make none feasible."""
    door = Door()
    monkeypatch.setattr("dynreg.gait.sines.Sines.problems", lambda *_: ("fl_hip would turn at 99 rad/s",))
    monkeypatch.setattr("dynreg.gait.sines.Sines.require_any", lambda *_: None)
    with pytest.raises(UsageError, match="cannot be run .* fl_hip would turn"):
        calibrated(opened, brief, door)
    assert not door.names
    monkeypatch.undo()
    assert calibrated(opened, brief, door, trials=1).cost.trials == 1, "none was begun, so none is lost"


def test_no_gait_that_the_simulator_can_do_is_no_fall(opened: Session, brief: Robot, monkeypatch) -> None:
    monkeypatch.setattr(
        by_reality.Played, "__call__", lambda self, gaits, some: np.zeros((len(some), len(gaits)))
    )
    none = np.empty((0, len(gait_space(brief, task_of(brief).motion).bounds)))
    monkeypatch.setattr("dynreg.verbs.calibrate_by_trials._gaits", lambda *_: none)
    with pytest.raises(NoMatchError, match="no gait scores above 0 in the simulator"):
        calibrated(opened, brief, Door())


def test_trials_of_one_folder_are_not_taken_for_those_of_another(
    opened: Session, brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stops(line: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dynreg.verbs.trial_folder.QUIET", 0.0)
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, tmp_path / "one", say=stops)
    (tmp_path / "one" / "trial_1_score.txt").write_text("0.2")
    with pytest.raises(UsageError, match="nothing to resume .* expected --trial .*one; give"):
        calibrated(opened, brief, tmp_path / "two", resume=True, trials=1)
    with pytest.raises(UsageError, match="expected no --budget, no --goal, --trial .*one; give") as error:
        calibrated(opened, brief, tmp_path / "two", resume=True, trials=1, budget=10**6, goal=9.0)
    assert "{" not in str(error.value), "the table of all rules was shown"
    monkeypatch.chdir(tmp_path)
    found = calibrated(opened, brief, "one", resume=True, trials=1)
    assert found.on_robot.scores() == [0.2]


def test_a_calibration_that_runs_is_not_begun_beside_itself(opened: Session, brief: Robot) -> None:
    def door(actions: np.ndarray, rate: float, name: str) -> float:
        with pytest.raises(UsageError, match="another run of the same calibration"):
            calibrated(opened, brief, door, resume=True, trials=1)
        return 0.1

    assert calibrated(opened, brief, door, trials=1).cost.trials == 1


def test_a_run_goes_on_with_its_goal_alone_and_with_more_trials(opened: Session, brief: Robot) -> None:
    aimed = Rules(**{**vars(TINY), "goal": 99.0})
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, Door(2), rules=aimed)
    with pytest.raises(UsageError, match="no trials of an interrupted run"):
        calibrated(opened, brief, Door(), rules=Rules(**{**vars(TINY), "goal": 98.0}), resume=True)
    door = Door()
    found = calibrated(opened, brief, door, rules=aimed, resume=True, trials=5)
    assert door.names[-1] == "trial_5" and found.cost.trials == 5


def test_a_run_that_ended_is_not_played_again_by_resume(opened: Session, brief: Robot) -> None:
    calibrated(opened, brief, Door(), trials=3)
    door = Door()
    with pytest.raises(UsageError, match="no trials of an interrupted run.*leave out --resume"):
        calibrated(opened, brief, door, trials=6, resume=True)
    assert door.names == []


def test_a_result_that_cannot_be_stored_loses_no_trial(
    opened: Session, brief: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = type(opened.registry).put_result

    def full(self, kind: str, *told) -> str:
        if kind != "calibration":
            return stored(self, kind, *told)  # the gait still has room
        raise OSError("no room")

    first, second = Door(), Door()
    with monkeypatch.context() as patched:
        patched.setattr(type(opened.registry), "put_result", full)
        with pytest.raises(OSError, match="no room"):
            calibrated(opened, brief, first, trials=3)
    found = calibrated(opened, brief, second, trials=3, resume=True)
    assert found.cost.trials == 3 == len(first.names) and second.names == []


def test_trials_outlive_another_version_of_what_simulates(
    opened: Session, brief: Robot, whole: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = Door(6), Door()
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, first)
    played = by_reality.Played.__call__
    monkeypatch.setattr(versions, "version", lambda name: "9.9")
    monkeypatch.setattr(by_reality.Played, "__call__", lambda self, *told: -played(self, *told))
    calibrated(opened, brief, second, resume=True)
    assert "trial_1" not in second.names, "simulations that trials followed from are not run again"


def test_the_stored_answer_of_a_run_that_ended_is_given(opened: Session, brief: Robot) -> None:
    first, door = calibrated(opened, brief, Door(), trials=3), Door()
    with pytest.warns(Assumed, match="has ended: its result"):
        again = calibrated(opened, brief, door, trials=3, resume=True)
    assert again.to_dict() == first.to_dict() and door.names == []


@pytest.mark.parametrize("where", [b'"asked"', b'"stage"'])
def test_damaged_simulations_are_run_again_and_no_trial_is_lost(
    opened: Session, brief: Robot, whole: Calibration, where: bytes
) -> None:
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, Door(2))
    every = [*(opened.path / "searches").glob("*.jsonl")]
    (journal,) = [path for path in every if b'"gaits 1"' in path.read_bytes()[:400]]
    journal.write_bytes(journal.read_bytes().replace(where, b'"oops"', 1))
    with pytest.warns(Assumed, match="the simulations of 'gaits 1' are run again"):
        found = calibrated(opened, brief, Door(), resume=True)
    assert found.on_robot.scores() == whole.on_robot.scores()


def test_a_damaged_journal_of_trials_is_kept(opened: Session, brief: Robot) -> None:
    with pytest.raises(KeyboardInterrupt):
        calibrated(opened, brief, Door(2))
    (journal,) = [p for p in (opened.path / "searches").iterdir() if b'"trials"' in p.read_bytes()[:400]]
    broken = journal.read_bytes().replace(b'"asked"', b'"akse"', 1)
    journal.write_bytes(broken)
    for resume in (False, True):
        with pytest.raises(CorruptError, match="line 2 is damaged.*another --seed"):
            calibrated(opened, brief, Door(), resume=resume)
    assert journal.read_bytes() == broken


def test_what_was_interrupted_in_a_new_registry_leaves_it_there(brief: Robot, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), dynreg.open(tmp_path / "new") as made:
        calibrated(made, brief, Door(2))
    door = Door()
    with dynreg.open(tmp_path / "new", create=False) as again:
        found = calibrated(again, brief, door, resume=True, trials=4)
    assert door.names == ["trial_4"] and found.cost.trials == 4, "the third was begun"


@pytest.mark.parametrize("budget", [{"trials": 3}, {"seconds": 5.0}])
def test_the_budget_ends_it_without_an_error(opened: Session, brief: Robot, budget: dict) -> None:
    door, seconds = Door(), task_of(brief).seconds
    found = calibrated(opened, brief, door, **budget)
    assert found.ended == next(iter(budget)) and found.cost.falls == 0
    assert len(door.names) == found.cost.trials == min(3 if "trials" in budget else 5.0 // seconds, 12)


def test_a_task_that_is_met_ends_it(opened: Session, brief: Robot) -> None:
    met = calibrated(opened, brief, Door(), goal=1e-6, rules=Rules(**{**vars(TINY), "difference": "rank"}))
    assert met.on_robot.difference == "rank" and {one.unit for one in met.versions} == {""}
    assert met.ended == "goal" and met.cost.trials == 2, "those of the first gait"


def test_the_search_for_gaits_may_be_another(opened: Session, brief: Robot) -> None:
    """A setting, or one of the rules: the same trials; and not those of the usual search."""
    tried = {}
    for how in ({}, {"search": "cma"}, {"rules": replace(TINY, search="cma")}):
        door = Door()
        found = calibrated(opened, brief, door, trials=6, **how)
        tried[str([*how])] = [one.to_dict() for one in found.on_robot.tried]
    assert tried["['search']"] == tried["['rules']"] != tried["[]"]
    with pytest.raises(UsageError, match="search.*has no meaning for method 'cma'"):
        opened.calibrate("log", method="cma", search="roulette")


def test_mistakes_have_one_clear_line_each(opened: Session, brief: Robot, short_log) -> None:
    opened.ingest(short_log, brief, name="log")
    door = Door()
    with pytest.raises(UsageError, match="0.1 s of trials, and one of task 'forward' takes 1 s"):
        calibrated(opened, brief, door, seconds=0.1)
    assert not door.names, "nothing moved"
    with pytest.raises(NoMatchError, match="every one of the gaits .* fell on robot 'quadruped'"):
        calibrated(opened, brief, Door(falls=True))
    with pytest.raises(NoMatchError, match=r"tried \(2\) fell .*ended by: falls"):
        calibrated(opened, brief, Door(falls=True), falls=2, seed=4)
    with pytest.raises(UsageError, match="'log'.*reads no recording|reads no recording such as 'log'"):
        calibrated(opened, "log", Door())
    with pytest.raises(UsageError, match="method 'btr' without a robot to try"):
        calibrated(opened, brief, None)
    for method in ("cma", "diagnose", "nearest"):
        with pytest.raises(
            UsageError, match=f"method '{method}' needs a recording, and 'quadruped' is a robot"
        ):
            opened.calibrate("quadruped", method=method)
    for told in ({"robot": "diffdrive"}, {"log_map": "map.toml"}):
        with pytest.raises(UsageError, match=f"{[*told][0]} '{[*told.values()][0]}' with"):
            calibrated(opened, brief, door, **told)
    with pytest.raises(UsageError, match="hold_out '0.25' has no meaning for method 'btr'"):
        calibrated(opened, brief, door, hold_out="0.25")
    with pytest.raises(UsageError, match="trials '9' has no meaning for method 'cma'"):
        opened.calibrate("log", trials=9)
    with pytest.raises(UsageError, match="robot_door has no meaning for method 'cma'"):
        opened.calibrate("log", robot_door=door)
    with pytest.raises(LogError, match="has the score nan"):
        calibrated(opened, brief, lambda *_: float("nan"), seed=5)


@pytest.mark.parametrize(
    ("told", "says"),
    [({}, "method 'btr' without a robot to try"), ({"robot": "diffdrive"}, "robot 'diffdrive' with method")],
)
def test_options_are_looked_at_before_anything_heavy_is_loaded(
    opened: Session, monkeypatch: pytest.MonkeyPatch, told: dict, says: str
) -> None:
    monkeypatch.setitem(sys.modules, "dynreg.verbs.calibrate_by_trials", None)  # to import it fails
    with pytest.raises(UsageError, match=says):
        opened.calibrate("quadruped", method="btr", **told)


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"gait": "nothing"}, "nothing"),
        ({"start": "nothing"}, "nothing"),
        ({"task": "nothing"}, "nothing"),
        ({"budget": 3}, "a budget of 3 simulations"),
        ({"seconds": 0.1}, "0.1 s of trials"),
    ],
)
def test_a_mistake_in_an_option_makes_no_folder(
    opened: Session, brief: Robot, tmp_path: Path, told: dict, says: str
) -> None:
    with pytest.raises(DynregError, match=says):
        opened.calibrate(brief, method="btr", robot_door=tmp_path / "trials", **told)
    assert not (tmp_path / "trials").exists()


def test_a_tape_measure_and_a_folder_will_do(
    opened: Session, brief: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynreg.verbs.trial_folder.QUIET", 0.0)
    monkeypatch.setattr("dynreg.verbs.trial_folder.EVERY", 0.01)
    folder, over, said = tmp_path / "trials", threading.Event(), []

    def person() -> None:
        """Plays each table, and writes how far it went, or that it fell."""
        while not over.is_set():
            for table in folder.glob("trial_*.csv"):
                score = folder / f"{table.stem}_score.txt"
                if not score.exists() and any(score.name in line for line in said):
                    number = int(table.stem.removeprefix("trial_"))
                    score.with_suffix(".part").write_text("fell\n" if number == 2 else f"0.{number + 10}\n")
                    score.with_suffix(".part").rename(score)
            time.sleep(0.01)

    measuring = threading.Thread(target=person)
    measuring.start()
    try:
        found = calibrated(opened, brief, folder, trials=6, say=said.append)
    finally:
        over.set()
        measuring.join()
    scores = found.on_robot.scores()
    assert scores[1] is None and [s for i, s in enumerate(scores) if i != 1] == [0.11, 0.13, 0.14, 0.15, 0.16]
    assert found.cost.falls == 1 and found.cost.discarded == 2
    asked = [line for line in said if " on the robot (1 s)" in line]
    assert str(folder / "trial_1.csv") in asked[0] and len(asked) == 6
    question = {"task": task_of(brief), "method": "btr", "seed": 3, "goal": None, "search": "roulette"}
    quiet = ScoredFolder(folder, opened.registry, brief, say=said.append, most=6, **question)
    told = np.loadtxt(folder / "trial_1.csv", delimiter=",", skiprows=1)[:, 1:]
    assert quiet.told(told, brief.rate, "trial_1") == 0.11, "it is there already"


@pytest.mark.parametrize("line", ["", "about a metre", "nan", "0.3 0.4", "0_82", "0,82", "0.3\n0.4"])
def test_a_file_of_a_score_with_another_line_is_refused(tmp_path: Path, line: str) -> None:
    (tmp_path / "trial_1_score.txt").write_text(line, encoding="utf-8")
    with pytest.raises(LogError, match=r"trial_1_score.txt' says"):
        read_score(tmp_path / "trial_1_score.txt")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(("line", "score"), [("0.82\r\n", 0.82), ("Fell\r\n", None)])
def test_a_score_is_read_as_usual_programs_write_it(
    tmp_path: Path, encoding: str, line: str, score: float | None
) -> None:
    (tmp_path / "trial_1_score.txt").write_bytes(line.encode(encoding))
    assert read_score(tmp_path / "trial_1_score.txt") == score


def test_a_gait_of_another_robot_is_refused(opened: Session, brief: Robot) -> None:
    genes = gait_space(brief).as_dict(gait_space(brief).bounds.mean(axis=1))
    with pytest.raises(UsageError, match="does not fit"):
        calibrated(opened, brief, Door(), gait={**genes, "wings": 2.0})
