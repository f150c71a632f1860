"""Legs that hang free in turn: slow and fast reversals within the limits, in which play is found."""

from copy import deepcopy
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from changed_robot import changed

from dynreg.diagnose.diagnose import diagnose
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.errors import UsageError
from dynreg.evidence.lockstep import run as answered
from dynreg.evidence.truth import Protocol, hide, log_of
from dynreg.excite import legs
from dynreg.excite.legs import Hanging, HangingLegs, hanging_legs
from dynreg.sim.effects import term
from dynreg.sim.excitation import reset_pose
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Rollout

SECONDS = 20.0  # of a leg: three episodes each to fit and to select


@pytest.fixture(scope="module")
def simulated() -> list[Rollout]:
    """What was simulated for `made`, in the order in which it was asked for."""
    return []


@pytest.fixture(scope="module")
def made(simulated: list[Rollout]) -> HangingLegs:
    simulate = legs.rollout
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(legs, "rollout", lambda *a, **k: simulated.append(simulate(*a, **k)) or simulated[-1])
        return hanging_legs(load_robot("quadruped"), ("fl",), seconds=SECONDS)


@pytest.fixture(scope="module")
def leg(made: HangingLegs) -> Hanging:
    return made.legs[0]


def test_one_leg_reverses_and_the_others_hold_still(made: HangingLegs, leg: Hanging) -> None:
    actions, pose = leg.run.actions, reset_pose(made.robot)
    assert (leg.leg, leg.joints) == ("fl", ("fl_hip", "fl_shoulder", "fl_elbow"))
    assert (actions[..., 3:] == pose[3:]).all()
    turns = (np.diff(np.sign(np.diff(actions[..., :3], axis=1)), axis=1) != 0).sum(axis=1)  # (E, 3)
    slow = [name.startswith("slow") for name in leg.patterns]
    assert (turns >= 1).all() and turns[np.logical_not(slow)].min() > turns[slow].max()


def test_the_limits_are_kept(made: HangingLegs, leg: Hanging) -> None:
    actions, limits = leg.run.actions, made.limits
    assert (actions >= limits.low).all() and (actions <= limits.high).all()
    from_pose = np.concatenate([np.tile(reset_pose(made.robot), (len(actions), 1, 1)), actions], axis=1)
    assert (np.abs(np.diff(from_pose, axis=1)) <= limits.rate / made.robot.rate + 1e-9).all()


def test_what_fits_comes_again_to_select_and_other_commands_test(leg: Hanging) -> None:
    assert leg.names == ("fit_0", "fit_1", "fit_2", "select_0", "select_1", "select_2", "test_0", "test_1")
    assert leg.held_out == ("test_0", "test_1")
    assert (leg.run.actions[:3] == leg.run.actions[3:6]).all()
    assert not {*leg.patterns[6:]} & {*leg.patterns[:6]}
    assert leg.run.episodes * leg.run.steps * leg.run.period == pytest.approx(SECONDS)


def test_play_shows_in_every_joint_and_a_stiff_spring_hardly(leg: Hanging) -> None:
    """Encoders of 2 mrad do not see a spring 27 times stiffer than the servo."""
    assert leg.nats.shape == (2, 3)
    assert leg.nats[0].min() > 50.0 and 0.0 < leg.nats[1].max() < 10.0


def test_the_commands_are_a_log(made: HangingLegs, leg: Hanging) -> None:
    recording = made.recording(leg)
    assert recording.names == made.robot.actions and not recording.measured
    assert [e.name for e in recording.episodes] == list(leg.names)
    ends = [(e.time[0], e.time[-1]) for e in recording.episodes]
    assert all(before[1] < after[0] for before, after in zip(ends, ends[1:], strict=False))


def test_the_same_seed_gives_the_same_commands(
    leg: Hanging, simulated: list[Rollout], monkeypatch: pytest.MonkeyPatch
) -> None:
    again = hanging_legs(load_robot("quadruped"), ("fl",), seconds=SECONDS, threads=1).legs[0]
    same = iter(simulated)  # so that the seed alone makes other commands, and nothing is simulated for it
    monkeypatch.setattr(legs, "rollout", lambda *_, **__: next(same))
    other = hanging_legs(load_robot("quadruped"), ("fl",), seconds=SECONDS, seed=1).legs[0]
    assert (again.run.actions == leg.run.actions).all() and not (other.run.actions == leg.run.actions).all()


@pytest.mark.parametrize(
    "robot, legs, seconds, says",
    [
        ("quadruped", ("tail",), 20.0, "leg 'tail'"),
        ("quadruped", (), 20.0, "no leg"),
        ("quadruped", ("fl",), 10.0, "15 to"),
        ("quadruped", ("fl",), 1000.0, "fewer seconds"),
        ("husky", ("all",), 20.0, "no legs"),
    ],
)
def test_what_cannot_hang_is_refused(robot: str, legs: tuple, seconds: float, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        hanging_legs(load_robot(robot), legs, seconds=seconds)


def test_every_episode_ends_with_a_row_that_holds(made: HangingLegs, leg: Hanging) -> None:
    for episode, actions in zip(made.recording(leg).episodes, leg.run.actions, strict=True):
        assert (episode.values[:-1] == actions).all() and (episode.values[-1] == actions[-1]).all()


def test_patterns_that_diverge_are_left_out(
    leg: Hanging, simulated: list[Rollout], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fast one that was taken before, and a slow one; all else does what it did."""
    lost = [commands_of(leg, name) for name in (leg.patterns[1], leg.patterns[0])]
    did = cycle(simulated)

    def diverging(robot, values, run, **asked):
        out = deepcopy(next(did))
        assert len(out.states) == len(values)
        for actions in lost[:many]:
            out.states[:, (run.actions == actions).all(axis=(1, 2)), 5:] = np.nan
        return out

    monkeypatch.setattr(legs, "rollout", diverging)
    many = 1
    again = hanging_legs(load_robot("quadruped"), ("fl",), seconds=SECONDS).legs[0]
    assert leg.patterns[1] not in again.patterns and np.isfinite(again.nats).all()
    many = 2
    with pytest.raises(UsageError, match="leg 'fl' .* in 2 of the 17 patterns.*expected 2 slow and 3 fast"):
        hanging_legs(load_robot("quadruped"), ("fl",), seconds=SECONDS)


def test_patterns_beyond_the_stops_are_left_out(leg: Hanging, tmp_path: Path) -> None:
    hip = 'name = "fl_hip/position"\nunit = "rad"\nlow = '
    narrow = changed(tmp_path / "dog", "quadruped", {f"{hip}-6.3": f"{hip}-0.35"})
    column = narrow.channels.index("fl_hip/position")
    again = hanging_legs(narrow, ("fl",), seconds=SECONDS).legs[0]
    low = {name: least for name, least in zip(leg.patterns, leg.reached[:, 0, column], strict=True)}
    gone = {name for name, least in low.items() if least < -0.375}  # the stop and two hundredths of the range
    assert gone == {"chirp from 2 to 4 Hz, reach 0.7"} and not gone & {*again.patterns}
    assert again.reached[:, 0, column].min() > -0.375


def commands_of(leg: Hanging, pattern: str) -> np.ndarray:
    """The commands (T, A) of a pattern that was chosen."""
    return leg.run.actions[leg.patterns.index(pattern)]


@pytest.mark.slow
def test_play_in_a_hanging_leg_is_found(made: HangingLegs, leg: Hanging) -> None:
    robot, run = made.robot, leg.run
    begin = np.arange(run.episodes) * (run.steps * run.period + 1.0)
    hidden = hide(robot, (term("backlash[fl_elbow]"),), "medium", 101)
    log = log_of(robot, hidden, Protocol(replace(run, begin=begin), leg.names))
    options = DiagnosisOptions(
        hold_out=",".join(leg.held_out), joints=leg.joints, threshold_runs=0, max_causes=1
    )
    state = answered(diagnose(robot, log, options)).found
    assert state.accepted and state.current.hypothesis.key == "backlash[fl_elbow]"
