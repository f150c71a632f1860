"""The zeros of encoders that are set anew at every start, and joints on which an effect acts already."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.diagnose import Found
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Point
from dynreg.diagnose.shortlist import REFINED, _probes
from dynreg.diagnose.threshold import Threshold
from dynreg.diagnose.trial import Tried, covered
from dynreg.evidence.truth import Hidden
from dynreg.diagnose.zeros import rezeroed
from dynreg.rng import stream
from dynreg.sim.effects import term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

OFF = np.array(
    [[0.03, -0.02], [-0.02, 0.03], [0.02, 0.01], [-0.03, -0.02]]
)  # rad, of each episode; mean zero
SECONDS, PERIOD = 1.0, 0.002


def _recording(robot) -> Recording:
    rng = stream(0, "test zeros")
    time = np.arange(int(SECONDS / PERIOD) + 1) * PERIOD
    waves = 2 * np.pi * rng.uniform(0.5, 1.5, (len(OFF), 1, 2)) * time[None, :-1, None]
    actions = 0.6 * np.sin(waves + rng.uniform(0, 6, (len(OFF), 1, 2)))
    initial = np.zeros((len(OFF), len(robot.channels)))
    run = Run(actions, initial=initial, period=PERIOD)
    states = rollout(robot, robot.space.nominal[None], run, threads=1).states[0]
    states[..., :2] -= OFF[:, None]  # the encoders read less than is true
    names = (*robot.channels, *robot.actions)
    units = ("rad", "rad", "rad/s", "rad/s", "N*m", "N*m")
    episodes = tuple(
        Episode(f"run {i}", time, np.hstack([s, np.vstack([a, a[-1:]])]), {})
        for i, (s, a) in enumerate(zip(states, actions, strict=True))
    )
    return Recording(tuple(Channel(n, u) for n, u in zip(names, units, strict=True)), episodes)


@pytest.fixture(scope="module")
def posed():
    robot = load_robot("double_pendulum")
    settings = DiagnosisOptions(hold_out="0", threads=1)
    return pose(robot, _recording(robot), settings)


def test_zeros_of_episodes_are_found(posed):
    problem, split = posed
    point = Point(Hypothesis(), np.zeros(len(problem.coordinates)), np.zeros(0))
    raw, before = problem.windows, problem.spent.candidates
    found = rezeroed(problem, raw, point, split.chosen)
    assert problem.spent.candidates > before + 10  # the rollouts count as the diagnosis's own
    moved = (found.run.initial - raw.run.initial)[:, :2]
    assert np.allclose(moved, OFF[raw.episode], atol=2e-3)
    assert np.allclose(found.measured[:, :, :2] - raw.measured[:, :, :2], moved[:, None])
    assert np.array_equal(found.measured[..., 2:], raw.measured[..., 2:])  # velocities have no zero to set


def test_zeros_stay_where_none_is_set_anew(posed):
    problem, split = posed
    channels = [c.model_copy(update={"zero": 0.0}) for c in problem.robot.file.channels]
    file = problem.robot.file.model_copy(update={"channels": channels})
    same = replace(problem, robot=replace(problem.robot, file=file))
    point = Point(Hypothesis(), np.zeros(len(problem.coordinates)), np.zeros(0))
    assert rezeroed(same, problem.windows, point, split.chosen) is problem.windows


def test_probes_of_what_acts_already_are_small():
    base = Point(Hypothesis((term("coulomb_friction"),)), np.zeros(7), np.array([0.7]))
    sizes = {
        key: float(_probes(base, term(key))[0].effect[-1])
        for key in ("coulomb_friction[shoulder]", "inertia[elbow]")
    }
    assert sizes == {"coulomb_friction[shoulder]": REFINED, "inertia[elbow]": 1.0}


def test_a_trial_tells_an_interval_in_the_zeros_that_the_effect_was_fitted_with(posed):
    """As logged, the zeros of the episodes would hide a friction that the same log without them rules out."""
    problem, split = posed
    friction = term("coulomb_friction")
    point = Point(Hypothesis((friction,)), np.zeros(len(problem.coordinates)), np.array([0.001]))
    zeroed = replace(problem, windows=rezeroed(problem, problem.windows, point, split.chosen))
    found = Found(point, point, (), 1, Threshold(0.0, ()), zeroed)
    held = {}
    for size in (0.0004, 0.002):  # N*m; the point has 0.0003
        hidden = Hidden((friction,), (np.array([size]),), problem.robot.space.nominal, 0)
        held[size] = covered(Tried(hidden, problem, split, found, "named", 0.0, 0.0))
    assert held == {0.0004: True, 0.002: False}
