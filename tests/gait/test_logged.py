"""A walk read from the log of a trial: as far as the robot went, fallen where it fell, and no other trial's."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Recording
from dynreg.errors import BudgetError, LogError
from dynreg.gait.logged import LoggedRobot, walk_of
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.sim.excitation import excitation
from dynreg.sim.real import Budget, RealTrial, SimulatedRobot
from dynreg.sim.robot import Robot

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
        walk = walk_of(quadruped, trial.recording, actions, RATE)
        assert walk.base.shape == trial.walk.base.shape
        assert walk.fell == trial.walk.fell
        own, true = walk.base[0, 0], trial.walk.base[0, 0]
        assert np.abs(own[-1, :2] - (true[-1, :2] - true[0, :2])).max() < 0.03
        assert np.abs(own[-1, 3:6] - true[-1, 3:6]).max() < 0.05


def test_a_log_may_begin_before_the_gait_and_hold_places(quadruped, gaits, tried) -> None:
    plain = walk_of(quadruped, tried[0].recording, gaits[0], RATE).base
    early = walk_of(quadruped, changed(tried[0].recording, lead=1.5), gaits[0], RATE).base
    assert np.abs(early[0, 0, -1, :2] - plain[0, 0, -1, :2]).max() < 0.03

    log, true = tried[0].recording, tried[0].walk.base[0, 0]
    places = [replace(log.channels[0], name=f"base/{axis}", unit="m") for axis in "xy"]
    seen = replace(
        log.episodes[0], values=np.concatenate([log.episodes[0].values, 7.0 + true[:, :2]], axis=1)
    )
    told = changed(
        replace(log, channels=(*log.channels, *places), episodes=(seen,)), drop=("base/vx", "base/vy")
    )
    walk = walk_of(quadruped, told, gaits[0], RATE).base[0, 0]
    assert np.abs(walk[-1, :2] - (true[-1, :2] - true[0, :2])).max() < 0.01


def test_a_robot_that_was_stopped_counts_as_fallen(quadruped, gaits, tried) -> None:
    steps = len(gaits[0])
    for share, fell in ((0.95, steps + 1), (0.5, steps // 2)):
        log = changed(tried[0].recording, rows=slice(0, round(share * steps)))
        assert walk_of(quadruped, log, gaits[0], RATE).fell[0, 0] == fell


def test_a_log_that_does_not_tell_is_refused(quadruped, gaits, tried) -> None:
    log = tried[0].recording
    with pytest.raises(LogError, match="commands differ by"):
        walk_of(quadruped, tried[1].recording, gaits[0], RATE)
    for drop in ("base/vy", "base/yaw"):
        with pytest.raises(LogError, match="does not tell how far 'quadruped' walked"):
            walk_of(quadruped, changed(log, drop=(drop,)), gaits[0], RATE)
    with pytest.raises(LogError, match="fl_hip/target"):
        walk_of(quadruped, changed(log, drop=("fl_hip/target",)), gaits[0], RATE)


def test_a_users_robot_is_counted_and_asked_no_more_than_its_budget_allows(quadruped, gaits, tried) -> None:
    logs, asked = iter([trial.recording for trial in tried]), []

    def played(actions: np.ndarray, rate: float, name: str) -> Recording:
        asked.append((name, rate, len(actions)))
        return next(logs)

    real = LoggedRobot(quadruped, played, Budget(trials=2))
    trials = [real.run(actions, RATE, f"t{i}") for i, actions in enumerate(gaits)]
    assert [t.fell for t in trials] == [False, True]
    assert real.spent.trials == 2 and real.spent.falls == 1
    with pytest.raises(BudgetError, match="2 trials"):
        real.run(gaits[0], RATE)
    assert asked == [("t0", RATE, len(gaits[0])), ("t1", RATE, len(gaits[1]))]
