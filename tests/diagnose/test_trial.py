"""One threshold serves all trials under the same commands: that of the robots without an effect, found once."""

import pytest

from dynreg.diagnose.threshold import level
from dynreg.diagnose.trial import Trials, null_scores, trial_threshold
from dynreg.evidence.truth import protocol
from dynreg.sim.robot import load_robot


def test_the_threshold_of_trials_is_the_level_of_their_robots_scores():
    robot = load_robot("diffdrive")
    trials = Trials(robot, protocol(robot, seed=1, seconds=12.5), threshold_runs=2, threads=1)
    scores = null_scores(trials, range(2))
    assert trial_threshold(trials) == pytest.approx(level(scores), rel=1e-12)
    assert null_scores(trials, [1]) == scores[1:], "each robot's score is its own"
    assert trials.truth_engine != robot.running(None)
