"""Plans made from a recording of a robot whose truth is known: they are driven on it, stored, and the same again."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driven_robot import PERIOD, commands, config, logged

import dynreg
from dynreg.cli.main import main
from dynreg.errors import LogError, RobotError, UsageError
from dynreg.report.html import page as page_of
from dynreg.report.navigation import error_words
from dynreg.results import Navigation
from dynreg.session import Session
from dynreg.sim.robot import Robot, load_robot
from dynreg.timed.commands import AXES
from dynreg.timed.compare import FACTORS
from dynreg.timed.models import Kinematic
from dynreg.timed.told import told
from dynreg.verbs.navigate_settings import NavigateSettings
from dynreg.verbs.navigation import _limits, _notes, planned

QUICK = {"generations": 25, "drives": 200, "threads": 1}
LAGS = {
    "speed_lag": 0.15,
    "yaw_lag": 0.18,
    "yaw_drag": 1.04,
}  # of the hidden robot: the closed form knows none
PLACE = (0.5, 0.1)
WHEEL = load_robot("diffdrive").file.base.wheel_radius  # m


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory, robot: Robot) -> Session:
    session = dynreg.open(tmp_path_factory.mktemp("navigate") / "registry")
    log = logged(robot, config(robot, LAGS), [commands(robot, 150, 1)], engine="unicycle", noise=0.1)
    session.ingest(log, "diffdrive", name="monday")
    session.ingest(logged(robot, config(robot), [commands(robot, 20, 2)]), "diffdrive", name="short")
    yield session
    session.close()


@pytest.fixture(scope="module")
def found(registry: Session) -> Navigation:
    return registry.navigate("monday", visit=[PLACE], back=False, on="kinematic", **QUICK)


def test_a_plan_keeps_to_what_the_recording_and_the_robot_can(found: Navigation, robot: Robot) -> None:
    assert found.places[0].visited and found.end < 0.075 and 1 <= len(found.commands) <= 10
    values = np.array([c.values for c in found.commands])
    assert np.abs(values).max() <= 0.7 * robot.file.actions[0].high
    lasts = np.array([c.seconds for c in found.commands])
    assert (
        lasts.min() >= 0.1
        and lasts.max() <= 0.5
        and lasts / PERIOD == pytest.approx(np.round(lasts / PERIOD))
    )
    begins = [c.time for c in found.commands]
    assert begins == pytest.approx([0.0, *np.cumsum(lasts)[:-1]]) and found.seconds == pytest.approx(
        lasts.sum()
    )
    assert found.parts == {"fit": 103, "validation": 23, "test": 24} and found.recording_name == "monday"


def test_the_table_drives_the_robot_as_far_off_as_the_drives_say(found: Navigation, robot: Robot) -> None:
    """The hidden robot lags behind the closed form, which made the plan."""
    table = found.to_frame()
    assert table["seconds"].iloc[-1] == 0.0 and not table[list(robot.actions)].iloc[-1].any()
    rows = np.round(table["seconds"] / PERIOD).astype(int)
    driven = table[list(robot.actions)].to_numpy().repeat(rows, axis=0)
    log = logged(robot, config(robot, LAGS), [driven], engine="unicycle")
    end = log.episodes[0].values[-1, log.columns(["base/x", "base/y"])]
    assert (
        found.end < np.hypot(*(end - PLACE)) < found.drive_ends.high
        and found.end < found.drive_ends.low < found.drive_ends.value
    )
    assert [way.x[0] for way in (found.way, *found.ways)] == [0.0] * 7 and len(
        {way.x for way in found.ways}
    ) > 1
    assert found.places[0].drives == found.all_visited <= found.drives == 200


def test_a_plan_is_stored_and_the_same_seed_makes_it_again(registry: Session, found: Navigation) -> None:
    again = registry.navigate("monday", visit=PLACE, back=False, on="kinematic", **QUICK | {"threads": 2})
    assert again.model_dump(exclude={"cost"}) == found.model_dump(exclude={"cost"})
    assert registry.result("@last") == again
    other = registry.navigate("monday", visit=[PLACE], back=False, on="kinematic", seed=1, **QUICK)
    assert other.commands != found.commands


def test_a_plan_comes_back_by_more_commands_and_says_what_it_misses(registry: Session) -> None:
    far = registry.navigate("monday", visit=[(9.0, 0.0)], on="kinematic", **QUICK)
    assert (
        not far.places[0].visited
        and far.all_visited == 0
        and "does not do all that was asked" in far.notes[0]
    )
    reach = 10 * far.limits.seconds[1] * max(map(abs, (*far.limits.low, *far.limits.high))) * WHEEL
    found = re.search(
        r"a way of at least 17.7 m, and these commands go at most ([\d.]+) m; try", far.notes[0]
    )
    assert 0.5 * reach < float(found[1]) <= 1.01 * reach and "--generations" not in far.notes[0]
    assert far.area == pytest.approx((0.0, -0.15, 9.15, 0.15)) and far.goal == "the start"
    brief = registry.navigate(
        "monday", visit=[PLACE], seconds=(0.1, 0.2), commands=3, on="kinematic", **QUICK
    )
    assert max(c.seconds for c in brief.commands) <= 0.2 and len(brief.commands) <= 3


def test_commands_that_are_left_out_are_in_no_table(registry: Session) -> None:
    near = registry.navigate("monday", visit=[(0.05, 0.0)], back=False, on="kinematic", **QUICK)
    assert 1 <= len(near.commands) < 10 and near.places[0].visited
    assert near.seconds == pytest.approx(sum(c.seconds for c in near.commands)) and near.end < 0.05


def test_the_models_errors_are_of_the_commands_at_the_end(
    registry: Session, found: Navigation, robot: Robot
) -> None:
    known = told(robot, registry.recording("monday"), longest=2.0)
    last = slice(-found.parts["test"], None)
    off = np.abs(known.moved[last] - Kinematic(known.track).predict(known.commands.take(last))).mean(axis=0)
    assert [found.errors[axis].mean for axis in AXES] == pytest.approx(off * FACTORS)


def test_drives_take_errors_of_commands_without_a_gap(robot: Robot) -> None:
    """Of four episodes the last 24 commands are parts of two; none holds as many as the plan has."""
    log = logged(
        robot, config(robot, LAGS), [commands(robot, n, n) for n in (60, 66, 12, 12)], engine="unicycle"
    )
    asked = NavigateSettings(visit=[PLACE], back=False, on="kinematic", **QUICK)
    found = planned(robot, log, asked)
    used, first = int((~found.plan.null).sum()), found.parts[2].start
    episode = found.told.episode[first:][found.runs]
    assert (episode == episode[:, :1]).all() and {*episode.ravel()} == {2, 3}
    assert found.runs.shape[1] == min(used, 12) and (np.diff(found.runs, axis=1) == 1).all()
    assert not any("without a gap" in note for note in _notes(found))
    cut = replace(found, runs=found.runs[:, : used - 1])
    assert f"no more than {used - 1} of those to test" in " ".join(_notes(cut))


def test_times_keep_to_what_was_asked_and_the_document_holds_the_limits(
    registry: Session, robot: Robot
) -> None:
    asked = {"visit": [PLACE], "back": False, "on": "kinematic", **QUICK, "generations": 2}
    told_so = registry.navigate("monday", seconds=(0.11, 0.15), commands=4, **asked)
    assert told_so.limits.seconds == (0.12, 0.14) and told_so.limits.commands == 4
    assert {round(c.seconds, 9) for c in told_so.commands} <= {0.12, 0.14}
    values = np.array([c.values for c in told_so.commands])
    assert (values >= told_so.limits.low).all() and (values <= told_so.limits.high).all()
    assert 0.5 * robot.file.actions[0].high < told_so.limits.high[0] < 0.7 * robot.file.actions[0].high
    assert not told_so.limits.beyond and "hardly" not in str(told_so)
    with pytest.raises(UsageError, match=r"0.05,0.05; expected at least one multiple of 0.02 s between them"):
        registry.navigate("monday", seconds=(0.05, 0.05), **asked)


def test_short_commands_that_lead_nowhere_are_told_with_times_to_ask_for(robot: Robot) -> None:
    """Three of a hundred commands last longer; beyond what most last, the headline says so."""
    brief = commands(robot, 97, 1, seconds=(0.12, 0.12))
    brief = np.concatenate([commands(robot, 3, 2, seconds=(1.6, 1.6)), brief])
    log = logged(robot, config(robot), [brief], engine="unicycle")
    asked = {"visit": [(0.8, 0.0)], "back": False, "on": "kinematic", **QUICK, "generations": 2}
    found = planned(robot, log, NavigateSettings(**asked))
    (note,) = _notes(found)
    assert "19 of 20 commands of the recording last 0.12 s or less, so try --seconds 0.5,1.6" in note
    longer = planned(robot, log, NavigateSettings(**asked, seconds=(0.5, 1.6)))
    assert "hardly known" in _notes(longer)[-1] and _limits(longer).beyond and not _limits(found).beyond


def test_a_start_in_a_place_is_told(registry: Session) -> None:
    asked = {"visit": [(0.0, 0.1), PLACE], "on": "kinematic", **QUICK, "generations": 2}
    notes = registry.navigate("monday", **asked).notes
    assert [note for note in notes if "start" in note] == ["the start already lies in the place 0,0.1"]


def test_a_page_of_a_stored_plan_is_the_same(registry: Session) -> None:
    found = registry.navigate("monday", visit=[PLACE], on="dynamic", **QUICK | {"generations": 2})
    stored = registry.result("@last")
    assert list(stored.errors) == list(found.errors) == [*AXES]
    assert stored.to_json() == found.to_json() and error_words(stored) == error_words(found)
    assert page_of(stored) == page_of(found)


def test_what_cannot_be_planned_is_refused(registry: Session) -> None:
    with pytest.raises(UsageError, match="longest command lasts 0.5 s"):
        registry.navigate("monday", visit=[PLACE], seconds=(0.1, 3.0), on="kinematic", **QUICK)
    with pytest.raises(LogError, match="20 commands, 3 of them to test") as refused:
        registry.navigate("short", visit=[PLACE], **QUICK)
    assert "--longest" not in str(refused.value) and str(refused.value).endswith("record more")
    with pytest.raises(LogError, match="fit model 'network'.*in all; record more, or name another .* --on$"):
        registry.navigate("monday", visit=[PLACE], on="network", **QUICK)
    with pytest.raises(RobotError, match="has no wheels"):
        planned(load_robot("servo_pendulum"), registry.recording("monday"), NavigateSettings(visit=[PLACE]))
    for wrong in ((), (1.0,), ("a", 1.0), (float("inf"), 0.0), None):
        with pytest.raises(UsageError, match="visit"):
            registry.navigate("monday", visit=wrong)


def test_the_command_goes_the_whole_way(registry: Session, found: Navigation, tmp_path: Path, capsys) -> None:
    out = tmp_path / "plan.csv"
    line = f"--registry {registry.path} navigate monday --visit 0.5,0.1 --no-back --on kinematic --generations 25"
    assert main([*line.split(), "--drives", "200", "--threads", "1", "--quiet", "-o", str(out)]) == 0
    assert str(found) in " ".join(capsys.readouterr().out.split())
    assert out.read_text(encoding="utf-8") == found.to_frame().to_csv(index=False)


def test_a_robot_whose_wheels_have_no_limits_goes_as_fast_as_the_recording_did(
    tmp_path: Path, registry: Session, found: Navigation
) -> None:
    """Limits that robot.toml does not state were a traceback."""
    folder = tmp_path / "free"
    shutil.copytree(load_robot("diffdrive").folder, folder)
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    free = re.sub(r'(unit = "rad/s"\n)low = .*\nhigh = .*\n', r"\1", text)
    assert free != text
    (folder / "robot.toml").write_text(free, encoding="utf-8")
    robot = load_robot(folder)
    assert np.isinf(robot.action_ranges).all()
    log = registry.recording("monday")
    made = planned(robot, log, NavigateSettings(visit=(PLACE,), back=False, on="kinematic", **QUICK))
    most = np.abs(np.stack([made.told.commands.left, made.told.commands.right])).max() / WHEEL
    assert 0.0 < np.abs(made.values).max() <= most


def test_the_longest_time_that_an_error_offers_is_taken(registry: Session, robot: Robot) -> None:
    """1.19 was offered where the longest command lasted 1.187 s."""
    log = registry.recording("monday")
    slow = replace(log, episodes=tuple(replace(e, time=1.0074 * e.time) for e in log.episodes))
    asked = {"visit": (PLACE,), "on": "kinematic", **QUICK}
    with pytest.raises(UsageError) as refused:
        planned(robot, slow, NavigateSettings(seconds=(0.1, 30.0), **asked))
    longest = float(refused.value.expected.removeprefix("no more than "))
    assert 0.49 < longest <= 1.0074 * 0.5
    assert (
        planned(robot, slow, NavigateSettings(seconds=(0.1, longest), **asked)).ranges.seconds[1] <= longest
    )
