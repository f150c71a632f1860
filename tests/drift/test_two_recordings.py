"""Drift of hidden robots on two wheels: what changed is found and named, and where nothing did, nothing is."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_wheels import logged, logs, robot

from dynreg.data.recording import Episode, Recording
from dynreg.drift.compared import Held
from dynreg.drift.drift import drift
from dynreg.errors import LogError, RobotError, UsageError
from dynreg.results import Drift
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.drift import DriftSettings
from dynreg.verbs.drift_document import document

SEEDS = 20
PIECES = DriftSettings(splits=0)


@pytest.fixture(scope="module")
def diffdrive() -> Robot:
    return load_robot("diffdrive")


@pytest.fixture(scope="module")
def before() -> Recording:
    return logged(robot(), 1)


@pytest.fixture(scope="module")
def slower(before: Recording) -> Recording:
    return logged(robot("left wheel", 0.8), 2)


def found(owner: Robot, before: Recording, after: Recording, settings: DriftSettings = PIECES) -> Drift:
    recent, earlier = Held(after, "after"), Held(before, "before")
    return document(owner, recent, earlier, settings.plan, drift(owner, recent, earlier, settings.plan))


# ---- what changed ----


@pytest.mark.parametrize(
    "pattern, factor", [("left wheel", 0.8), ("right wheel", 1.1), ("all speeds", 0.85), ("turns only", 0.85)]
)
def test_what_changed_is_named_with_its_factor(
    pattern: str, factor: float, diffdrive: Robot, before: Recording
) -> None:
    result = found(diffdrive, before, logged(robot(pattern, factor), 2))
    assert (result.verdict, result.pattern, result.rivals) == ("moved", pattern, ())
    best = result.patterns[0]
    assert best.name == pattern and best.share > 0.9
    assert best.low < factor < best.high and best.high - best.low < 0.02
    assert result.rejected > 0.1 * result.tests > 20
    assert result.rejected == sum(s.rejected for c in result.cells for s in c.shifts.values())
    assert f"{pattern} x" in str(result)


def test_a_change_between_drives_that_are_not_alike_is_told_with_a_doubt(
    diffdrive: Robot, before: Recording, slower: Recording
) -> None:
    """Straight drives are a small part of those to which the reference was fitted."""
    alike = found(diffdrive, before, slower)
    assert alike.verdict == "moved" and not [n for n in alike.notes if "of the driving is alike" in n]
    straight = found(diffdrive, before, logged(robot("left wheel", 0.8), 2, like="straight"))
    (note,) = [n for n in straight.notes if "of the driving is alike" in n]
    assert straight.verdict == "moved" and 0 < int(note.split(" %")[0]) < 50


def test_the_interval_holds_as_often_as_it_says(diffdrive: Robot) -> None:
    """95 % of twelve: fewer than ten would be one case in fifty."""
    held = 0
    changes = ((), ("all speeds", 0.85))
    pairs = logs([(robot(*c), 2 * n + i) for n in range(12) for i, c in enumerate(changes)], episodes=8)
    for before, after in zip(pairs[::2], pairs[1::2], strict=True):
        best = found(diffdrive, before, after).patterns[0]
        held += best.low < 0.85 < best.high
    assert held >= 10


def test_the_strongest_shift_comes_first_and_is_where_the_wheel_turns(
    diffdrive: Robot, before: Recording, slower: Recording
) -> None:
    result = found(diffdrive, before, slower)
    strength = [max(abs(s.sigmas) for s in c.shifts.values()) for c in result.cells]
    assert strength == sorted(strength, reverse=True)
    assert all(abs(c.left) > 0.06 for c in result.moved[:10])
    for c in result.moved[:10]:  # a slower left wheel: less ahead, and more to the left
        assert np.sign(c.shifts["dy"].value) == -np.sign(c.left)
        assert np.sign(c.shifts["dtheta"].value) == np.sign(c.left)


def test_a_small_change_that_no_cell_shows_is_found_by_its_pattern(
    diffdrive: Robot, before: Recording
) -> None:
    result = found(diffdrive, before, logged(robot("all speeds", 0.99), 3))
    assert result.rejected == 0 and (result.verdict, result.pattern) == ("moved", "all speeds")
    assert any("pools all" in note for note in result.notes)
    assert result.patterns[0].low < 0.99 < result.patterns[0].high


def test_what_commands_cannot_tell_apart_is_said_with_those_that_can(diffdrive: Robot) -> None:
    """The left wheel alone says nothing of the right one."""
    pair = (
        logged(robot(*change), seed, like="left alone")
        for seed, change in ((1, ()), (2, ("left wheel", 0.8)))
    )
    result = found(diffdrive, *pair)
    assert result.pattern is None and set(result.rivals) == {"left wheel", "all speeds"}
    first = result.separate_by[0]
    assert first.left == pytest.approx(first.right) and first.apart > 3 and not first.known
    assert "cannot tell apart" in str(result)


def test_a_slippery_floor_has_moved_and_no_pattern_is_said_to_explain_it_well(
    diffdrive: Robot, before: Recording
) -> None:
    """Slip is outside of what any pattern says: the best of them leaves much."""
    result = found(diffdrive, before, logged(robot(grip=1.0), 2))
    assert result.verdict == "moved" and result.patterns[0].share < 0.5
    assert str(result).endswith(" % of the squared shifts")
    assert any("explains" in note and "not all of it" in note for note in result.notes)
    pure = found(diffdrive, before, logged(robot("all speeds", result.patterns[0].factor), 2))
    assert pure.patterns[0].share > 0.9 and "squared shifts" not in str(pure)


def test_a_factor_at_a_bound_is_said_to_stand_there(diffdrive: Robot) -> None:
    """Wheels that hardly turn any more: 0.1 of what they did, half of the least that is looked for."""
    pair = (logged(robot(*c), i, noise=0.2) for i, c in enumerate(((), ("all speeds", 0.1))))
    result = found(diffdrive, *pair)
    best = result.patterns[0]
    assert (result.pattern, best.at_bound) == ("all speeds", True)
    assert best.low == 0.2 and best.factor == pytest.approx(0.2, rel=1e-3)
    assert "at a bound of the search" in str(result) and any("0.2 to 5" in note for note in result.notes)
    assert Drift.model_validate_json(result.to_json()) == result


def test_wheels_that_were_never_told_to_turn_leave_their_factor_open(diffdrive: Robot) -> None:
    """The right wheel stood still: its factor is anything, and the document can be read again."""
    pair = (logged(robot(), seed, like="left alone") for seed in (1, 2))
    result = found(diffdrive, *pair)
    right = next(p for p in result.patterns if p.name == "right wheel")
    assert (right.low, right.high, right.at_bound) == (0.2, 5.0, False)
    assert all(0.2 <= p.low <= p.factor <= p.high <= 5.0 for p in result.patterns)
    assert Drift.model_validate_json(result.to_json()) == result


# ---- what did not ----


def test_without_a_change_alarms_are_as_rare_as_stated(diffdrive: Robot) -> None:
    """The false-discovery rate is kept: alarms in at most 5 %, so that 5 of 20 have a chance of 1 in 400."""
    alarms, below, tests = 0, 0, 0
    same = logs([(robot(), seed) for seed in range(2 * SEEDS)], episodes=8)
    for pair in zip(same[::2], same[1::2], strict=True):
        result = found(diffdrive, *pair)
        alarms += result.verdict == "moved"
        below += sum(s.p < 0.05 for c in result.cells for s in c.shifts.values())
        tests += result.tests
        assert result.false_alarms.expected == pytest.approx(0.05 * result.tests)
    assert alarms < 5
    assert tests > 3000 and 0.025 < below / tests < 0.06  # what is stated for the tests one by one


def test_one_by_one_there_are_false_alarms_and_they_are_measured(diffdrive: Robot, before: Recording) -> None:
    same = logged(robot(), 4)
    for welch in (False, True):
        alone = found(diffdrive, before, same, DriftSettings(together=False, welch=welch, splits=40))
        assert 0.02 * alone.tests < alone.rejected < 0.09 * alone.tests
        assert alone.test == ("welch" if welch else "student") and not alone.together
        rates = alone.false_alarms
        assert rates.splits == 40 and rates.by == "episodes" and 0.01 < rates.one_by_one < 0.08
        assert rates.alarms > 0.5  # of many tests at 5 % some are mostly below
        kept = found(diffdrive, before, same, DriftSettings(welch=welch, splits=40))
        assert kept.rejected == 0 and kept.false_alarms.alarms < 0.5


def test_the_same_seed_gives_the_same_document(
    diffdrive: Robot, before: Recording, slower: Recording
) -> None:
    runs = [found(diffdrive, before, slower, DriftSettings(splits=10, seed=s)) for s in (3, 3, 4)]
    one, again, other = (r.model_copy(update={"seconds": 0.0}) for r in runs)
    assert one == again and one.false_alarms != other.false_alarms


def test_what_was_not_split_is_not_called_too_small(diffdrive: Robot) -> None:
    """Three commands cannot be split into halves of two samples each; but here that was asked for only once."""
    few = [logged(robot(), seed, episodes=1, each=3, ticks=(10, 40)) for seed in (1, 3)]
    for splits, told in ((0, False), (5, True)):
        result = found(diffdrive, *few, DriftSettings(cells=1, splits=splits))
        assert result.tests == 3 and result.false_alarms.splits == 0
        assert any("too small" in note for note in result.notes) == told


def test_too_little_data_is_no_verdict(diffdrive: Robot) -> None:
    pair = (logged(robot(), seed, episodes=1, each=3) for seed in (1, 2))
    result = found(diffdrive, *pair)
    assert result.verdict == "too little data" and result.tests == 0 and result.cells == ()
    assert result.false_alarms.one_by_one is None and result.patterns == ()
    assert any("fewer --cells" in note for note in result.notes)
    pair = (logged(robot(), seed, episodes=1, each=40) for seed in (1, 2))
    assert found(diffdrive, *pair, replace(PIECES, cells=3)).tests > 10


# ---- what is left out ----


def test_pieces_that_are_too_short_too_long_or_too_fast_are_counted(
    diffdrive: Robot, before: Recording
) -> None:
    taken = found(diffdrive, before, logged(robot(), 2, ticks=(4, 10))).recent
    assert taken.short > 0.8 * taken.pieces and (taken.long, taken.outside) == (0, 0)
    e = before.episodes[0]
    fast = e.values.copy()
    fast[:, 3] *= np.where(np.abs(fast[:, 3]) > 8.0, 2.0, 1.0)  # beyond 15 rad/s
    outside = Recording(before.channels, (Episode("fast", e.time, fast), *before.episodes[1:]))
    assert found(diffdrive, before, outside).recent.outside > 10
    slow = Recording(before.channels, (Episode("slow", 20.0 * e.time, e.values), *before.episodes[1:]))
    assert found(diffdrive, before, slow).recent.long > 100  # a pose a second
    rare = Recording(
        before.channels, tuple(Episode(x.name, 20.0 * x.time, x.values) for x in before.episodes)
    )
    for pair, name in (((rare, before), "before"), ((before, rare), "after")):
        with pytest.raises(LogError, match=rf"'{name}' has no command of 0.5 s .* give --sample 1"):
            found(diffdrive, *pair)


def test_speeds_that_the_earlier_recording_never_had_are_told(tmp_path: Path, before: Recording) -> None:
    """Without limits in robot.toml a robot that is driven faster now was judged on the overlap alone, in silence."""
    folder = tmp_path / "free"
    shutil.copytree(load_robot("diffdrive").folder, folder)
    text = (folder / "robot.toml").read_text(encoding="utf-8")
    (folder / "robot.toml").write_text(text.replace("low = -15.0\nhigh = 15.0\n", ""), encoding="utf-8")
    free, wheels = load_robot(folder), np.array([0.0, 0.0, 0.0, 0.4, 0.4])
    slow = tuple(replace(e, values=e.values * np.where(wheels > 0.0, wheels, 1.0)) for e in before.episodes)
    told = found(free, replace(before, episodes=slow), before)
    assert told.recent.outside > 0.3 * told.recent.pieces
    assert any("pieces of the recent recording are left out because" in note for note in told.notes)
    fast = tuple(replace(e, values=e.values + 50.0 * wheels) for e in before.episodes)
    with pytest.raises(LogError, match="'after' has no command at the compared speeds: .* driven as fast"):
        found(free, replace(before, episodes=slow), replace(before, episodes=fast))


# ---- what is refused ----


@pytest.mark.parametrize(
    "wrong, says",
    [
        ({"sample": 0.0}, "a number above 0"),
        ({"sample": np.nan}, "a number above 0"),
        ({"cells": 0}, "1 to 200"),
        ({"level": 1.0}, "between 0 and 1"),
        ({"splits": -1}, "0 or more"),
    ],
)
def test_settings_that_cannot_be_are_refused(wrong: dict, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        DriftSettings(**wrong)


def test_recordings_that_cannot_be_compared_are_refused(diffdrive: Robot, before: Recording) -> None:
    with pytest.raises(UsageError, match="'after' against itself"):
        found(diffdrive, before, before)
    with pytest.raises(RobotError, match="'servo_pendulum' has no wheels of which one"):
        found(load_robot("servo_pendulum"), before, logged(robot(), 2))
    blind = Recording(
        before.channels[1:], tuple(Episode(e.name, e.time, e.values[:, 1:]) for e in before.episodes)
    )
    for pair in ((before, blind), (blind, before)):
        with pytest.raises(LogError, match="no channel 'base/x'"):
            found(diffdrive, *pair)
