"""One threshold serves all trials under the same commands: that of the robots without an effect, found once."""

import pytest

from dynreg.diagnose.threshold import level
from dynreg.diagnose.trial import Trials, nulls, trial_threshold
from dynreg.evidence.truth import protocol
from dynreg.sim.robot import load_robot


def test_the_threshold_of_trials_is_the_level_of_their_robots_scores():
    robot = load_robot("diffdrive")
    trials = Trials(robot, protocol(robot, seed=1, seconds=12.5), threshold_runs=2, threads=1)
    made = nulls(trials, range(2))
    found = trial_threshold(trials)
    assert found.nats == pytest.approx(level([nats for nats, _ in made]), rel=1e-12)
    assert found.ratios == pytest.approx([left for _, left in made], rel=1e-12)
    assert nulls(trials, [1]) == made[1:], "what each robot says is its own"
    assert trials.truth_engine != robot.running(None)
