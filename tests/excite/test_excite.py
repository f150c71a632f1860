"""Commands for an experiment: they separate better than usual ones, keep the limits, and come out the same again."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.data.recording import Recording
from dynreg.data.table import write_csv
from dynreg.errors import DynregError, RobotError, UsageError
from dynreg.evidence.data import Data
from dynreg.evidence.fit import fit
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run as answered
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.evidence.truth import REACH, Hidden, measured_states, trial_settings
from dynreg.excite.choose import Search
from dynreg.excite.excite import excite
from dynreg.excite.limits import Limits
from dynreg.excite.rivals import first_starts
from dynreg.excite.separate import Pair
from dynreg.replay.parts import Parts
from dynreg.replay.windows import Windows
from dynreg.results import Experiment
from dynreg.sim.effects import term
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run
from dynreg.verbs.experiment import experiment as told_of

SECONDS = 5.0  # in 4 s flanks that only push show 6 nats of a play
PAIRS = (("payload", "coulomb_friction"), ("backlash", "command_deadband"))


@pytest.fixture(scope="module")
def servo() -> Robot:
    return load_robot("servo_pendulum")


@pytest.fixture(scope="module")
def answers(servo: Robot) -> dict[tuple[str, str], tuple[Recording, Experiment]]:
    return {pair: told(servo, pair, seconds=SECONDS, seed=0) for pair in PAIRS}


@pytest.mark.parametrize("pair", PAIRS, ids=["friction", "play"])
def test_they_separate_better_than_the_usual_ones(pair: tuple[str, str], answers) -> None:
    _, experiment = answers[pair]
    assert experiment.separation > 2 * experiment.usual and experiment.separation > 8.0
    assert (experiment.between, experiment.robot) == (pair, "servo_pendulum")


@pytest.mark.parametrize("pair", PAIRS, ids=["friction", "play"])
def test_robots_that_are_not_the_model_bear_it_out(pair: tuple[str, str], answers, servo: Robot) -> None:
    """Hidden robots on a finer time step, with quantised sensors, and both hypotheses fitted to their logs."""
    chosen = run_of(servo, answers[pair][0])
    usual = excitation(
        servo, seed=0, name="diagnose", episodes=chosen.episodes, steps=chosen.steps, reach=REACH
    )
    usual = replace(
        usual, settings=trial_settings(servo, chosen.episodes), initial=None, period=chosen.period
    )
    ours, theirs = (
        min(evidence(servo, run, pair), evidence(servo, run, pair[::-1])) for run in (chosen, usual)
    )
    assert ours > 8.0 and ours > 2 * theirs


@pytest.mark.parametrize("pair", PAIRS, ids=["friction", "play"])
def test_the_limits_are_kept_and_told(pair: tuple[str, str], answers, servo: Robot) -> None:
    recording, experiment = answers[pair]
    run = run_of(servo, recording)
    kept = {limit.name: limit for limit in experiment.limits}
    assert set(kept) == {"arm/target", "arm/target rate", "arm/position (expected)"}
    for limit in kept.values():
        assert limit.low <= limit.least <= limit.most <= limit.high
    assert (kept["arm/target"].least, kept["arm/target"].most) == (run.actions.min(), run.actions.max())
    fastest = np.abs(np.diff(run.actions, axis=1)).max() * servo.rate
    assert kept["arm/target rate"].most == pytest.approx(fastest)


def test_the_recording_can_be_played(answers, servo: Robot) -> None:
    recording, experiment = answers[PAIRS[0]]
    assert recording.names[0] == "arm/target" and not recording.measured
    assert set(recording.names) <= {"arm/target", "arm/enabled"}
    length = np.ptp(recording.episodes[0].time)  # to the row that closes it
    assert experiment.seconds == pytest.approx(len(recording.episodes) * length) == pytest.approx(SECONDS)
    ends = [(e.time[0], e.time[-1]) for e in recording.episodes]
    assert all(before[1] < after[0] for before, after in zip(ends, ends[1:], strict=False))
    for episode in recording.episodes:
        assert np.diff(episode.time) == pytest.approx(1 / servo.rate)
        for name, table in zip(servo.settings, servo.file.settings, strict=True):
            assert episode.settings[name] in table.trial
    for episode in recording.episodes:
        for name in ("kp", "added_mass"):
            nominal = {s.name: s.nominal for s in servo.file.settings}[name]
            assert (
                episode.settings[name] == nominal or f"{name} = {episode.settings[name]:g}" in experiment.note
            )


def test_the_same_seed_gives_the_same_bytes(servo: Robot, tmp_path) -> None:
    files = []
    for number, seed in enumerate((3, 3, 4)):
        recording, experiment = told(servo, ("speed_limit", "torque_limit"), seconds=1.0, seed=seed, rounds=1)
        write_csv(recording, tmp_path / f"{number}.csv")
        files.append((tmp_path / f"{number}.csv").read_bytes() + experiment.to_json().encode())
    assert files[0] == files[1] != files[2]


def test_progress_runs_to_its_end(servo: Robot) -> None:
    seen: list[tuple] = []
    pair, asked = ("speed_limit", "torque_limit"), {"seconds": 1.0, "seed": 0, "rounds": 1}
    excite(servo, pair, **asked, progress=lambda *a: seen.append(a))
    assert seen[0] == ("excite", 0, seen[0][2]) and seen[-1][1] == seen[-1][2]
    assert [done for _, done, _ in seen] == sorted(done for _, done, _ in seen)


def test_an_effect_that_another_contains_is_not_counted(servo: Robot) -> None:
    pair = ("coulomb_friction", "stribeck_friction")
    _, experiment = told(servo, pair, seconds=2.0, seed=0, rounds=1)
    assert experiment.separation > 10.0
    assert "if coulomb_friction is the true cause" in experiment.note


def test_effects_of_a_base_on_wheels_are_driven_apart() -> None:
    """Its disturbance is one of the speeds that it is told: it has no torques."""
    pair = ("wheel_slip", "rate_limit")
    recording, experiment = told(load_robot("diffdrive"), pair, seconds=2.0, seed=0, rounds=1)
    assert experiment.separation > 8.0
    assert recording.names[:2] == ("left_wheel/velocity_command", "right_wheel/velocity_command")
    kept = {limit.name: limit for limit in experiment.limits}
    for name in recording.names[:2]:
        assert kept[name].low <= kept[name].least < 0 < kept[name].most <= kept[name].high
        assert kept[f"{name} rate"].high is None and kept[f"{name} rate"].unit == "rad/s^2"
    assert all((episode.values[-1, :2] == 0.0).all() for episode in recording.episodes), "wheels are stopped"
    assert kept["base/x (expected)"].least < kept["base/x (expected)"].most
    assert (
        "base/x from" in experiment.note
        and "the last row of each sets all torques, voltages and speeds to 0" in experiment.note
    )


@pytest.mark.parametrize(
    "robot, pair, seconds, says",
    [
        ("servo_pendulum", ("gravity_tilt", "encoder_offset"), 4.0, "turn the base by 180 degrees"),
        ("servo_pendulum", ("command_delay", "sensor_delay"), 4.0, "loop-back"),
        ("servo_pendulum", ("payload", "backlash[leg]"), 4.0, "no action drives 'leg'"),
        ("servo_pendulum", ("payload", "ground_friction"), 4.0, "ground_friction"),
        ("servo_pendulum", ("payload", "rust"), 4.0, "unknown effect 'rust'"),
        ("servo_pendulum", ("payload", "inertia"), 0.5, "at least 0.8 s"),
        ("husky", ("payload", "inertia"), 4.0, "no engine.* has masses"),
    ],
)
def test_what_cannot_be_told_apart_is_refused(robot: str, pair: tuple, seconds: float, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        excite(load_robot(robot), pair, seconds=seconds, seed=0)


def test_effects_for_which_parameters_make_up_are_refused(servo: Robot) -> None:
    vague = [p.model_copy(update={"tolerance": 5.0}) for p in servo.file.parameters]
    space = replace(servo.space, parameters=tuple(replace(p, tolerance=5.0) for p in servo.space.parameters))
    robot = replace(servo, file=servo.file.model_copy(update={"parameters": vague}), space=space)
    with pytest.raises(DynregError, match="does not tell coulomb_friction from viscous_friction"):
        excite(robot, ("coulomb_friction", "viscous_friction"), seconds=1.0, seed=2, rounds=1)


def test_usual_commands_are_judged_with_the_inputs_that_a_robot_has_by_default(servo: Robot) -> None:
    limits = Limits.of(servo)
    search = Search.of(Pair(servo, (term("payload"), term("coulomb_friction"))), limits, 50, 4)
    inputs = search.judge.pool.run.inputs[..., servo.inputs.index("supply")]
    assert (inputs == servo.input_defaults[servo.inputs.index("supply")]).all()


def test_a_horizon_that_holds_no_episode_is_named(servo: Robot) -> None:
    short = servo.file.replay.model_copy(update={"horizon": 0.1})
    robot = replace(servo, file=servo.file.model_copy(update={"replay": short}))
    with pytest.raises(RobotError, match=r"holds 10 commands.*horizon = 0\.2 or more in \[replay\]"):
        excite(robot, ("payload", "coulomb_friction"), seconds=60.0, seed=0)


def told(robot: Robot, pair: tuple[str, str], **asked) -> tuple[Recording, Experiment]:
    """The commands, and what is said about them."""
    chosen = excite(robot, pair, **asked)
    return chosen.recording, told_of(chosen)


def run_of(robot: Robot, recording: Recording) -> Run:
    """The commands of a recording, begun in the reset pose."""
    values = np.array([episode.values for episode in recording.episodes])
    inputs = np.tile(robot.input_defaults, (*values.shape[:2], 1))
    for column, name in enumerate(recording.names[len(robot.actions) :], start=len(robot.actions)):
        inputs[..., robot.inputs.index(name)] = values[..., column]
    settings = np.array([[e.settings[name] for name in robot.settings] for e in recording.episodes])
    actions = values[..., : len(robot.actions)]
    return Run(actions, inputs=inputs, settings=settings, period=1.0 / robot.rate)


def evidence(robot: Robot, run: Run, names: tuple[str, str]) -> float:
    """[nats] by which the first effect, which a hidden robot has, beats the second: both fitted to its log."""
    pair = Pair(robot, (term(names[0]), term(names[1])))
    c, truth = pair.coordinates, pair.medium(0)[0]
    free = len(c)
    values = c.effect_values(pair.hypotheses[0], truth[None, free:])[0][0]
    hidden = Hidden((pair.terms[0],), (values,), robot.space.nominal, seed=5)
    measured = answered(measured_states(robot, hidden, run))
    weight = np.array([channel.weight for channel in robot.file.channels])
    windows = Windows(
        replace(run, initial=measured[:, 0]),
        measured,
        measured.std(axis=(0, 1)),
        weight / weight.sum(),
        np.arange(run.episodes),
        np.tile([0, run.steps + 1], (run.episodes, 1)),
        run.period,
    )
    every = np.ones(run.episodes, dtype=bool)
    model, data = Model(robot, c), Data.of(robot, windows, Parts(every, ~every, ~every))
    first, sample = _points(pair.hypotheses[0], free, [truth]), data.sample(data.fit)
    sample = sample.reweighted(answered(model.residuals(first, sample))[0])
    _, own = answered(fit(model, first, sample, iterations=5))
    others = _points(pair.hypotheses[1], free, first_starts(pair, 1))
    _, other = answered(fit(model, others, sample, iterations=8, tolerance=0.1))
    return float(other.min() - own.min())


def _points(hypothesis: Hypothesis, free: int, starts: list[np.ndarray]) -> list[Point]:
    return [Point(hypothesis, z[:free], z[free:]) for z in starts]
