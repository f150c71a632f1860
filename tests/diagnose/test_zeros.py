"""The zeros of encoders that are set anew at every start, and joints on which an effect acts already."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.diagnose import Diagnosed, left_over
from dynreg.diagnose.judging import judge
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans import Short
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.threshold import Threshold
from dynreg.diagnose.trial import Trials, Tried, covered
from dynreg.diagnose.verdict import Evidence, verdict_of
from dynreg.diagnose.zeros import rezeroed
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import counted, run
from dynreg.evidence.point import Point
from dynreg.evidence.truth import Hidden, protocol
from dynreg.rng import stream
from dynreg.sim.effects import term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

OFF = np.array(
    [[0.03, -0.02], [-0.02, 0.03], [0.02, 0.01], [-0.03, -0.02]]
)  # rad, of each episode; mean zero
SECONDS, PERIOD = 1.0, 0.002


def _recording(robot, off: np.ndarray = OFF) -> Recording:
    rng = stream(0, "test zeros")
    time = np.arange(int(SECONDS / PERIOD) + 1) * PERIOD
    waves = 2 * np.pi * rng.uniform(0.5, 1.5, (len(OFF), 1, 2)) * time[None, :-1, None]
    actions = 0.6 * np.sin(waves + rng.uniform(0, 6, (len(OFF), 1, 2)))
    initial = np.zeros((len(OFF), len(robot.channels)))
    moves = Run(actions, initial=initial, period=PERIOD)
    states = rollout(robot, robot.space.nominal[None], moves, threads=1).states[0]
    states[..., :2] -= off[:, None]  # the encoders read less than is true
    names = (*robot.channels, *robot.actions)
    units = ("rad", "rad", "rad/s", "rad/s", "N*m", "N*m")
    episodes = tuple(
        Episode(f"run {i}", time, np.hstack([s, np.vstack([a, a[-1:]])]), {})
        for i, (s, a) in enumerate(zip(states, actions, strict=True))
    )
    return Recording(tuple(Channel(n, u) for n, u in zip(names, units, strict=True)), episodes)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return _recording(load_robot("double_pendulum"))


@pytest.fixture(scope="module")
def posed(recording):
    return pose(load_robot("double_pendulum"), recording, DiagnosisOptions(hold_out="0", threads=1))


def test_zeros_of_episodes_are_found(posed):
    model, data = posed
    raw = data.windows
    found, many = run(counted(rezeroed(model, data, model.start, data.parts.chosen)))
    assert many > 10  # the rollouts count as the diagnosis's own
    moved = (found.run.initial - raw.run.initial)[:, :2]
    assert np.allclose(moved, OFF[raw.episode], atol=2e-3)
    assert np.allclose(found.measured[:, :, :2] - raw.measured[:, :, :2], moved[:, None])
    assert np.array_equal(found.measured[..., 2:], raw.measured[..., 2:])  # velocities have no zero to set


def test_what_all_episodes_share_is_left_to_the_causes():
    robot = load_robot("double_pendulum")
    asked = DiagnosisOptions(hold_out="0", threads=1)
    model, data = pose(robot, _recording(robot, OFF + 0.01), asked)
    found = run(rezeroed(model, data, model.start, data.parts.chosen))
    moved = (found.run.initial - data.windows.run.initial)[:, :2]
    assert np.allclose(moved, OFF[data.windows.episode], atol=4e-3)


def test_zeros_that_differ_are_no_unexplained_error():
    """They were fitted beside an accepted cause alone, so a robot that lacked nothing was called unknown."""
    robot = load_robot("double_pendulum")
    recording = _recording(robot.stepped(32))  # no error of the time step is left, which a robot has not
    model, data = pose(robot, recording, DiagnosisOptions(hold_out="0", threads=1))
    state = State(model, data.sample(data.fit), model.start, model.start)
    assert not run(Evidence.of(state, recording)).explained
    found = run(left_over(state, data, recording))
    assert found.explained and verdict_of(robot, found, (), 0) == "none"
    assert found.zeros == pytest.approx({"shoulder/position": 0.03, "elbow/position": 0.03}, abs=0.01)


def test_zeros_stay_where_none_is_set_anew(posed):
    model, data = posed
    channels = [c.model_copy(update={"zero": 0.0}) for c in model.robot.file.channels]
    file = model.robot.file.model_copy(update={"channels": channels})
    same = replace(model, robot=replace(model.robot, file=file))
    assert run(rezeroed(same, data, same.start, data.parts.chosen)) is data.windows


def test_a_trial_tells_an_interval_in_the_zeros_that_the_effect_was_fitted_with(posed, recording):
    """As logged, the zeros of the episodes would hide a friction that the same log without them rules out."""
    model, data = posed
    friction = term("coulomb_friction")
    point = Point(Hypothesis((friction,)), np.zeros(len(model.coordinates)), np.array([0.001]))
    windows = run(rezeroed(model, data, point, data.parts.chosen))
    state = State(model, replace(data, windows=windows).sample(data.fit), model.start, point, (), 1)
    evidence = run(Evidence.of(state, recording))
    problem = Problem(model, data, (friction,), Short())
    judged = run(judge(model, replace(state, accepted=0), model.start, data))
    made = Diagnosed(problem, state, Threshold(0.0, ()), evidence, judged, (), "named")
    trials = Trials(model.robot, protocol(model.robot), threads=1)
    held = {}
    for size in (0.0004, 0.002):  # N*m; the point has 0.0003
        hidden = Hidden((friction,), (np.array([size]),), model.robot.space.nominal, 0)
        held[size] = covered(trials, Tried(hidden, made, 0.0, 0.0))
    assert held == {0.0004: True, 0.002: False}
