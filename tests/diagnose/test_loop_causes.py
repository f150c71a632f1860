"""Causes in a drive's loop, its current and its encoder are named, and not their nearest relatives."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.diagnose import trial as trials_room
from dynreg.diagnose.threshold import USUAL, Threshold
from dynreg.diagnose.trial import Trial, Trials
from dynreg.evidence.truth import hide, protocol
from dynreg.results.trials import TrialResult
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot
from dynreg.verbs.trials import results_of

SEED = 20261131  # of the fixed robots
HIDDEN = ("feedback_delay", "torque_lag", "duty_limit", "profile_speed", "motor_elasticity")
COUNTS = (7.0, 24.0)  # of cogging, cycles a turn


def diagnosed(*todo: Trial) -> list[TrialResult]:
    """What is said of servo benches under the same commands, all in lockstep."""
    robot = load_robot("servo_pendulum")
    return results_of(
        Trials(robot, protocol(robot, seed=2, seconds=25.0), threads=1), todo, Threshold(USUAL, ())
    )


def said(results: list[TrialResult]) -> str:
    return "\n".join(f"{r.hidden} {r.size} {r.hidden_values} -> {r.verdict} {r.named}" for r in results)


def test_causes_of_the_loop_are_named():
    found = diagnosed(*(Trial((term(key),), "medium", SEED + i) for i, key in enumerate(HIDDEN)))
    assert all(r.right for r in found), said(found)
    errors = sorted(r.parameter_error for r in found)
    assert errors[len(errors) // 2] < 0.1, errors


def test_cogging_is_found_with_the_count_that_it_has(monkeypatch: pytest.MonkeyPatch):
    """A count is nothing that a fit walks to: all are probed. One start at 12 finds neither of these."""

    def counting(robot, terms, size, seed, **options):
        hidden = hide(robot, terms, size, seed, **options)
        sine, cosine, _ = hidden.values[0]
        return replace(hidden, values=(np.array([sine, cosine, COUNTS[seed - SEED]]),))

    monkeypatch.setattr(trials_room, "hide", counting)
    robot = load_robot("servo_pendulum")
    trials = Trials(robot, protocol(robot, seed=2, seconds=25.0), threads=1)
    todo = [Trial((term("cogging"),), "medium", SEED + i) for i in range(len(COUNTS))]
    for count, one in zip(COUNTS, trials_room.tried(trials, todo, Threshold(USUAL, ())), strict=True):
        point = one.made.found.current
        (values,) = one.made.found.model.coordinates.effect_values(point.hypothesis, point.effect[None])
        assert (one.first.key, one.made.verdict) == ("cogging", "named")
        assert values[0, 2] == pytest.approx(count, abs=0.1)
