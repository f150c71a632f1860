"""Where the windows of a diagnosis begin: a base on its feet where the log has it, else in its settled pose."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.compare.rollouts import score
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import pose
from dynreg.diagnose.verdict import EXPLAINED, Evidence, remaining, start_noise
from dynreg.evidence.lockstep import run
from dynreg.replay.judged import channel_errors
from dynreg.sim.config import SimConfig
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

ASKED = DiagnosisOptions(hold_out="away", threads=1)
AWAY = {"base/x": 0.5, "base/y": -0.3, "base/yaw": 0.6, "base/vx": 0.1}


def quadruped(base: str) -> Robot:
    """The packaged one in windows of a second, with a log of its place, too.

    base : where it begins when a log is replayed.
    """
    robot = load_robot("quadruped")
    of_yaw = robot.file.channels[robot.channels.index("base/yaw")]
    place = [of_yaw.model_copy(update={"name": f"base/{name}", "unit": "m"}) for name in "xyz"]
    file = robot.file.model_copy(
        update={
            "channels": [*robot.file.channels, *place],
            "reset": robot.file.reset.model_copy(update={"base": base}),
            "replay": robot.file.replay.model_copy(update={"horizon": 1.0}),
        }
    )
    return replace(robot, file=file)


def swayed(robot: Robot) -> Recording:
    """What the nominal robot logs as it sways on its feet; each second its joints stand as at first.

    Of the last episode the base is elsewhere, and on its way.
    """
    rest = Run(np.zeros((1, 1, len(robot.actions))), period=1 / robot.rate)
    stands = rollout(robot, robot.space.nominal[None], rest, threads=1).states[0, 0, 0]
    joints = [robot.channels.index(name.replace("/target", "/position")) for name in robot.actions]
    beat = np.sin(2 * np.pi * np.arange(round(3 * robot.rate)) / robot.rate)
    episodes = []
    for name, far in (("one", 0.1), ("two", 0.15), ("three", 0.08), ("four", 0.12), ("away", 0.2)):
        actions = stands[joints] + far * beat[:, None] * np.array([0.3, 1.0, -1.0] * 4)
        begin = stands.copy()
        if name == "away":
            begin[[robot.channels.index(one) for one in AWAY]] = list(AWAY.values())
        told = Run(actions[None], initial=begin[None], period=1 / robot.rate)
        states = rollout(robot, robot.space.nominal[None], told, threads=1).states[0, 0]
        rows = np.concatenate([states, np.concatenate([actions, actions[-1:]])], axis=1)
        episodes.append(Episode(name, np.arange(len(rows)) / robot.rate, rows))
    tables = (*robot.file.channels, *robot.file.actions)
    return Recording(tuple(Channel(t.name, t.unit) for t in tables), tuple(episodes), measured=False)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return swayed(quadruped("measured"))


def test_held_out_errors_are_those_that_a_comparison_tells(recording: Recording):
    robot = quadruped("measured")
    model, data = pose(robot, recording, ASKED)
    judged = np.flatnonzero(data.parts.test)
    states = run(model.states([model.start], data.windows.run.take(judged)))
    told = channel_errors(data.windows, states, judged)[0]
    nominal = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal))
    compared = score(robot, recording, {"nominal": (robot, nominal)}, [], "away", threads=1).errors[-1]
    assert compared.seconds == 1.0 and compared.rollouts == len(judged) > 1
    assert told[compared.channels] == pytest.approx(compared.mean[0, :-1])
    at = [robot.channels.index(name) for name in ("base/x", "base/y", "base/yaw")]
    assert told[at].max() < 0.01, "the simulator is the robot that was logged"


def test_a_base_that_stands_settled_begins_so_where_the_log_does_not_tell_its_attitude(recording: Recording):
    unknown = [i for i, one in enumerate(recording.channels) if one.name in ("base/roll", "base/pitch")]
    episodes = []
    for one in recording.episodes:
        values = one.values.copy()
        values[:, unknown] = np.nan
        episodes.append(replace(one, values=values))
    blind = replace(recording, episodes=tuple(episodes))
    begins = lambda base, log: pose(quadruped(base), log, ASKED)[1].windows.run.initial  # noqa: E731
    for base, log in (("keyframe", recording), ("measured", blind)):
        assert np.isnan(begins(base, log)[0]).all(), "its feet would be lifted by the noise of its joints"
    assert np.isfinite(begins("measured", recording)).all()


def test_what_the_noise_of_a_measured_start_does_to_rollouts_is_known(recording: Recording):
    model, data = pose(quadruped("measured"), recording, ASKED)
    told = run(start_noise(model, model.start, data.windows, rough=True))
    initial, robot = data.windows.run.initial, model.robot
    every = np.tile(np.arange(len(initial)), 8)
    off = np.random.default_rng(1).standard_normal((len(every), initial.shape[1])) * robot.sensor_noise
    noisy = replace(data.windows.run.take(every), initial=initial[every] + off)
    (states,) = run(model.states([model.start], noisy))
    apart = states - data.windows.measured[every]  # the log has no noise, and its robot is the simulator
    for name in ("base/x", "base/y", "base/yaw"):
        c = robot.channels.index(name)
        assert told[c] == pytest.approx(remaining(apart[:, 1:, c], rough=True), rel=0.3)
    some = data.windows.run.initial.copy()
    some[::2, robot.channels.index("base/roll")] = np.nan  # these begin settled, without that noise
    fewer = replace(data.windows, run=replace(data.windows.run, initial=some))
    half = run(start_noise(model, model.start, fewer, rough=True))
    c = robot.channels.index("base/yaw")
    assert 0.4 * told[c] < half[c] < told[c]
    model, data = pose(quadruped("keyframe"), recording, ASKED)
    assert not run(start_noise(model, model.start, data.windows, rough=True)).any()


def test_it_is_no_unknown_cause(recording: Recording):
    """Of a log with noise the simulator is the robot; yet its base is off by more than its noise."""
    robot, rng = quadruped("measured"), np.random.default_rng(0)
    noise = np.append(robot.sensor_noise, np.zeros(len(robot.actions)))
    episodes = [
        replace(one, values=one.values + noise * rng.standard_normal(one.values.shape))
        for one in recording.episodes
    ]
    log = replace(recording, episodes=tuple(episodes))
    model, data = pose(robot, log, ASKED)
    model = replace(model, accuracy=replace(model.accuracy, finer=1.0))  # as the log was made
    found = run(Evidence.of(State(model, data.sample(data.fit), model.start, model.start), log))
    assert found.noise.basis == "stated_noise" and found.noise.ratio < EXPLAINED
