"""A walk read from the log of a trial: as far as the robot went, fallen where it fell, and no other trial's."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.recording import Recording
from dynreg.errors import BudgetError, LogError
from dynreg.gait.logged import LoggedRobot, trial_of
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.sim.excitation import excitation
from dynreg.sim.real import Budget, RealTrial, SimulatedRobot
from dynreg.sim.robot import Robot, load_robot, packaged_robots

RATE = 36.0


@pytest.fixture(scope="module")
def gaits(quadruped: Robot) -> np.ndarray:
    """(2, T, A) commands of a packaged gait, and such as it tumbles with."""
    task = task_of(quadruped)
    task.seconds = 3.0
    trials = Trials(quadruped, task, Simulators(quadruped.space.nominal[None]), rate=RATE, threads=1)
    walks = trials.space.feasible(trials.space.from_unit(trials.space.starts[:1]))
    tumbles = excitation(quadruped, seed=3, episodes=1, steps=len(trials.times)).actions
    return np.concatenate([trials.space.targets(walks, trials.times), tumbles])


@pytest.fixture(scope="module")
def tried(quadruped: Robot, gaits: np.ndarray) -> tuple[RealTrial, ...]:
    real = SimulatedRobot(quadruped, quadruped.space.nominal, seed=3, threads=1)
    return tuple(real.run(actions, RATE) for actions in gaits)


def changed(
    log: Recording, drop: tuple[str, ...] = (), rows: slice = slice(None), lead: float = 0.0
) -> Recording:
    """The log without some channels, of some rows, after `lead` seconds at rest."""
    kept = [i for i, c in enumerate(log.channels) if c.name not in drop]
    (e,) = log.episodes
    still = round(lead * RATE)
    time = np.concatenate([np.arange(-still, 0) / RATE + e.time[0], e.time[rows]])
    values = np.concatenate([np.repeat(e.values[:1], still, axis=0), e.values[rows]])[:, kept]
    return replace(
        log, channels=tuple(log.channels[i] for i in kept), episodes=(replace(e, time=time, values=values),)
    )


def test_a_walk_is_that_of_the_robot_and_falls_when_it_falls(quadruped, gaits, tried) -> None:
    assert [trial.fell for trial in tried] == [False, True]
    for actions, trial in zip(gaits, tried, strict=True):
        walk = trial_of(quadruped, trial.recording, actions, RATE).walk
        assert walk.base.shape == trial.walk.base.shape
        assert walk.fell == trial.walk.fell
        own, true = walk.base[0, 0], trial.walk.base[0, 0]
        assert np.abs(own[-1, :2] - (true[-1, :2] - true[0, :2])).max() < 0.03
        assert np.abs(own[-1, 3:6] - true[-1, 3:6]).max() < 0.05


def test_a_log_may_begin_before_the_gait_and_hold_places(quadruped, gaits, tried) -> None:
    plain = trial_of(quadruped, tried[0].recording, gaits[0], RATE).walk.base
    early = trial_of(quadruped, changed(tried[0].recording, lead=1.5), gaits[0], RATE).walk.base
    assert np.abs(early[0, 0, -1, :2] - plain[0, 0, -1, :2]).max() < 0.03

    (e,) = tried[0].recording.episodes
    silent = e.values.copy()
    silent[:, tried[0].recording.columns(quadruped.actions)] = np.nan
    before = replace(e, name="before", values=silent)
    cut = replace(tried[0].recording, episodes=(before, replace(e, time=e.time + 100.0)))
    late = trial_of(quadruped, cut, gaits[0], RATE).walk.base
    assert np.abs(late[0, 0, -1, :2] - plain[0, 0, -1, :2]).max() < 1e-6

    log, true = tried[0].recording, tried[0].walk.base[0, 0]
    places = [replace(log.channels[0], name=f"base/{axis}", unit="m") for axis in "xyz"]
    seen = replace(
        log.episodes[0], values=np.concatenate([log.episodes[0].values, 7.0 + true[:, :3]], axis=1)
    )
    told = changed(
        replace(log, channels=(*log.channels, *places), episodes=(seen,)), drop=("base/vx", "base/vy")
    )
    walk = trial_of(quadruped, told, gaits[0], RATE).walk.base[0, 0]
    assert np.abs(walk[-1, :2] - (true[-1, :2] - true[0, :2])).max() < 0.01
    assert (
        np.abs(walk[:, 2] - true[:, 2]).max() < 0.01
    )  # heights, by which it may have fallen, from that at rest


def _with_keyframe(robot: Robot, height: float, folder: Path) -> Robot:
    """The robot, whose keyframe has the base at another height."""
    shutil.copytree(packaged_robots()[robot.name], folder)
    model = (folder / "model.xml").read_text(encoding="utf-8")
    lifted = model.replace('qpos="0 0 0.24 ', f'qpos="0 0 {height} ')
    assert lifted != model
    (folder / "model.xml").write_text(lifted, encoding="utf-8")
    return load_robot(folder)


@pytest.mark.parametrize("height", [0.0, 0.6])
def test_heights_are_counted_from_where_the_robot_stands_not_from_its_keyframe(
    quadruped, gaits, tried, tmp_path, height: float
) -> None:
    robot = _with_keyframe(quadruped, height, tmp_path / "quadruped")
    true = tried[0].walk.base[0, 0]
    walk = trial_of(robot, tried[0].recording, gaits[0], RATE)
    assert not walk.fell
    assert walk.walk.base[0, 0, 0, 2] == pytest.approx(true[0, 2], abs=0.005)

    log, (e,) = tried[0].recording, tried[0].recording.episodes
    sinks = 7.0 + true[:, 2:3] - np.linspace(0.0, 0.25, len(true))[:, None]
    z = replace(log.channels[0], name="base/z", unit="m")
    seen = replace(e, values=np.concatenate([e.values, sinks], axis=1))
    sunk = trial_of(robot, replace(log, channels=(*log.channels, z), episodes=(seen,)), gaits[0], RATE)
    assert sunk.fell
    assert 0.6 * len(true) < sunk.walk.fell[0, 0] < len(true)


@pytest.mark.parametrize(
    "share, lead", [(0.95, 0.0), (0.92, 2.0), (0.85, 0.0), (0.5, 0.0), (0.4, 1.5), (0.3, 4.0)]
)
def test_a_robot_that_was_stopped_counts_as_fallen(
    quadruped, gaits, tried, share: float, lead: float
) -> None:
    rows = round(share * len(gaits[0]))
    log = changed(tried[0].recording, rows=slice(0, rows), lead=lead)
    found = trial_of(quadruped, log, gaits[0], RATE)
    assert found.walk.fell[0, 0] == (rows if share < 0.9 else len(gaits[0]) + 1)
    assert found.fell == (share < 0.9)
    (episode,) = found.recording.episodes  # the trial alone, without the lead
    assert np.array_equal(episode.values, tried[0].recording.episodes[0].values[:rows])


def cut(log: Recording, *spans: tuple[float, float], lead: float = 0.0) -> Recording:
    """The log cut at gaps: an episode for each span [s], after one at rest for `lead` seconds."""
    (e,) = changed(log, lead=lead).episodes
    spans = (*([(-lead, -0.1)] if lead else ()), *spans)
    rows = [(e.time >= begin) & (e.time < end) for begin, end in spans]
    pieces = (replace(e, name=f"e{i}", time=e.time[r], values=e.values[r]) for i, r in enumerate(rows))
    return replace(log, episodes=(*pieces,))


@pytest.mark.parametrize("lead", [0.0, 1.0])
def test_a_log_that_was_cut_at_a_gap_is_read_across_it(quadruped, gaits, tried, lead: float) -> None:
    log = cut(tried[0].recording, (0.0, 1.4), (1.65, 9.0), lead=lead)
    found, whole = (trial_of(quadruped, one, gaits[0], RATE) for one in (log, tried[0].recording))
    assert not found.fell
    assert np.abs(found.walk.base[0, 0, -1, :2] - whole.walk.base[0, 0, -1, :2]).max() < 0.1
    # kept in two episodes: what is made of its rows must not take the gap for one step
    assert [len(e.time) for e in found.recording.episodes] == pytest.approx([51, 49], abs=1)


def test_a_log_that_is_silent_for_much_of_a_trial_tells_no_fall(quadruped, gaits, tried) -> None:
    with pytest.raises(LogError, match="silent for 0.8"):
        trial_of(quadruped, cut(tried[0].recording, (0.0, 1.4), (2.2, 9.0)), gaits[0], RATE)
    # the robot lay there by then
    (e,) = tried[1].recording.episodes
    time = e.time[-1] + 1.5 + np.arange(20) / RATE
    after = replace(e, name="after", time=time, values=np.repeat(e.values[-1:], 20, axis=0))
    found = trial_of(quadruped, replace(tried[1].recording, episodes=(e, after)), gaits[1], RATE)
    assert found.walk.fell[0, 0] == tried[1].walk.fell[0, 0]


def test_other_commands_after_a_gap_are_no_part_of_a_trial_that_was_stopped(quadruped, gaits, tried) -> None:
    (e,) = cut(tried[0].recording, (0.0, 1.4)).episodes
    (other,) = tried[1].recording.episodes
    later = replace(other, name="later", time=other.time + 2.0)
    found = trial_of(quadruped, replace(tried[0].recording, episodes=(e, later)), gaits[0], RATE)
    assert found.walk.fell[0, 0] == 51
    assert [one.name for one in found.recording.episodes] == ["e0"]


def test_what_a_robot_does_after_a_trial_or_a_fall_is_left_out(quadruped, gaits, tried) -> None:
    for actions, trial in zip(gaits, tried, strict=True):
        log = trial.recording
        (e,) = log.episodes
        after = e.time[-1] + np.arange(1, 60) / RATE
        still = np.repeat(e.values[-1:], len(after), axis=0)
        long = replace(e, time=np.r_[e.time, after], values=np.concatenate([e.values, still]))
        found = trial_of(quadruped, replace(log, episodes=(long,)), actions, RATE)
        assert found.walk.fell == trial.walk.fell
        assert len(found.recording.episodes[0].time) == len(e.time)


def test_a_log_of_another_rate_that_begins_elsewhere_and_turns_past_half_a_turn(
    quadruped, gaits, tried
) -> None:
    """100 Hz, out of phase, commands rounded; its yaw begins at 3 rad, and is logged within one turn."""
    (e,), names = tried[0].recording.episodes, tried[0].recording.names
    time = np.arange(0.013, e.time[-1], 0.01)
    values = np.stack([np.interp(time, e.time, column) for column in e.values.T], axis=1)
    told = [names.index(a) for a in quadruped.actions]
    values[:, told] = e.values[np.searchsorted(e.time, time, side="right") - 1][:, told].round(3)
    yaw = names.index("base/yaw")
    turning = values[:, yaw] + 3.0 + 0.3 * (time - time[0])
    values[:, yaw] = np.arctan2(np.sin(turning), np.cos(turning))
    log = replace(
        tried[0].recording,
        episodes=(
            replace(e, name="other", time=np.array([0.0, 1.0]), values=e.values[:2]),
            replace(e, time=time, values=values),
        ),
    )
    base = trial_of(quadruped, log, gaits[0], RATE).walk.base[0, 0]
    plain = trial_of(quadruped, tried[0].recording, gaits[0], RATE).walk.base[0, 0]
    assert base[0, 5] == pytest.approx(0.0, abs=1e-6)  # it looks ahead when it begins
    assert np.abs(np.diff(base[:, 5])).max() < 0.2
    assert base[-1, 5] == pytest.approx(plain[-1, 5] + 0.3 * e.time[-1], abs=0.05)
    assert np.hypot(*base[-1, :2]) == pytest.approx(np.hypot(*plain[-1, :2]), abs=0.2)
    assert np.median(np.abs(base[1:-1, 6:] - plain[1:-1, 6:])) < 0.1  # velocities, as logged


def test_rows_that_are_not_measured_are_filled_and_none_is_standing_still(quadruped, gaits, tried) -> None:
    log = tried[0].recording
    whole = trial_of(quadruped, log, gaits[0], RATE).walk.base[0, 0, -1, :2]

    def without(names: tuple[str, ...], rows: slice) -> Recording:
        (e,) = log.episodes
        values = e.values.copy()
        for name in names:
            values[rows, log.names.index(name)] = np.nan
        return replace(log, episodes=(replace(e, values=values),))

    for names, rows in (
        (("base/vx",), slice(20, 90)),
        (("base/roll",), slice(20, 30)),
        (("base/vy",), slice(0, 9)),
    ):
        filled = trial_of(quadruped, without(names, rows), gaits[0], RATE).walk.base[0, 0, -1, :2]
        assert np.abs(filled - whole).max() < 0.1
    with pytest.raises(LogError, match="in 0 of"):
        trial_of(quadruped, without(("base/pitch",), slice(None)), gaits[0], RATE)


@pytest.mark.parametrize("name", ["base/roll", "base/yaw"])
@pytest.mark.parametrize(
    ("lost", "said"), [((0.85, 1.0), "0.4"), ((0.05, 0.92), "2.6"), ((0.0, 0.15), "0.39"), ((0.92, 1.0), "")]
)
def test_a_base_that_is_lost_for_more_than_a_tenth_tells_neither_a_fall_nor_a_score(
    quadruped, gaits, tried, name: str, lost: tuple[float, float], said: str
) -> None:
    log, (e,) = tried[0].recording, tried[0].recording.episodes
    values = e.values.copy()
    first, end = (round(share * len(values)) for share in lost)
    values[first:end, log.names.index(name)] = np.nan
    seen = replace(log, episodes=(replace(e, values=values),))
    if said:
        with pytest.raises(LogError, match=f"silent for {said}.* about the base"):
            trial_of(quadruped, seen, gaits[0], RATE)
    else:
        assert not trial_of(quadruped, seen, gaits[0], RATE).fell


def _excited(robot: Robot) -> list[RealTrial]:
    """Trials of other commands, as a query's log has them."""
    real = SimulatedRobot(robot, robot.space.nominal, seed=3, threads=1)
    return [real.run(actions, RATE) for actions in excitation(robot, seed=7).actions[:8]]


def test_a_log_that_does_not_tell_is_refused(quadruped, gaits, tried) -> None:
    log = tried[0].recording
    (e,) = log.episodes
    alike = e.values.copy()  # another gait: the same joints a fifth further
    alike[:, log.columns(quadruped.actions)] *= 1.2
    for other in (
        tried[1].recording,
        changed(log, rows=slice(0, 1), lead=2.0),
        replace(log, episodes=(replace(e, values=alike),)),
        *(one.recording for one in _excited(quadruped)),
    ):
        with pytest.raises(LogError, match="the log's commands"):
            trial_of(quadruped, other, gaits[0], RATE)
    for drop in ("base/vy", "base/yaw"):
        with pytest.raises(LogError, match="does not tell how far 'quadruped' walked"):
            trial_of(quadruped, changed(log, drop=(drop,)), gaits[0], RATE)
    with pytest.raises(LogError, match="fl_hip/target"):
        trial_of(quadruped, changed(log, drop=("fl_hip/target",)), gaits[0], RATE)


def test_a_users_robot_is_counted_and_asked_no_more_than_its_budget_allows(quadruped, gaits, tried) -> None:
    logs, asked = iter([trial.recording for trial in tried]), []

    def played(actions: np.ndarray, rate: float, name: str) -> Recording:
        asked.append((name, rate, len(actions)))
        return next(logs)

    real = LoggedRobot(quadruped, played, budget=Budget(trials=2))
    trials = [real.run(actions, RATE, f"t{i}") for i, actions in enumerate(gaits)]
    assert [t.fell for t in trials] == [False, True]
    assert real.spent.trials == 2 and real.spent.falls == 1
    with pytest.raises(BudgetError, match="2 trials"):
        real.run(gaits[0], RATE)
    assert asked == [("t0", RATE, len(gaits[0])), ("t1", RATE, len(gaits[1]))]


def test_a_trial_whose_log_cannot_be_judged_has_moved_the_robot(quadruped, gaits, tried) -> None:
    real = LoggedRobot(
        quadruped, lambda *_: changed(tried[0].recording, drop=("base/yaw",)), budget=Budget(trials=1)
    )
    with pytest.raises(LogError):
        real.run(gaits[0], RATE)
    assert real.spent.trials == 1 and real.spent.seconds == pytest.approx(3.0)
    with pytest.raises(BudgetError):
        real.run(gaits[0], RATE)
