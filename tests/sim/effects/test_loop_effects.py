"""Effects of a drive's loop, its current and its encoder: each does what its definition says."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_benches import bench, rms

from dynreg.errors import UsageError
from dynreg.sim.effects import Effect, EffectParameter, Moment, Term, Terms, effects, placed, term
from dynreg.sim.engines import Arena, rollout
from dynreg.sim.engines.acting import require
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

E = effects()


class Witness(Effect):
    """Remembers what it saw, and changes nothing; only of the mujoco engine, which calls ports with arrays."""

    id, acts_on, title = "witness", "drive", "nothing"
    parameters = (EffectParameter("nothing", "1", "no meaning", 1.0, 1.0, 1.0, 1.0),)

    def __init__(self):
        self.seen: list[tuple[float, ...]] = []

    def command(self, u: np.ndarray, x: Moment, p) -> np.ndarray:
        self.sent = float(u[0, 0])
        return u

    def drive(self, torque: np.ndarray, x: Moment, p) -> np.ndarray:
        self.seen.append((self.sent, *(float(a[0, 0]) for a in (x.q, x.v, torque, x.stiffness, x.limit))))
        return torque


def witnessed(key: str, values: list[float], run: Run) -> np.ndarray:
    """(time steps, 6) command, position, speed, torque, stiffness and limit of the servo with that effect."""
    robot, witness = load_robot("servo_pendulum"), Witness()
    terms = Terms((Term(E[key]), Term(witness)), (np.array([values]), np.array([[1.0]])))
    rollout(robot, robot.space.nominal[None], run, engine="mujoco", threads=1, terms=terms)
    return np.array(witness.seen)


def lively() -> Run:
    """The first episode of the bench."""
    return bench("servo").run.take([0])


@pytest.mark.parametrize("steps", [2.0, 3.4])
def test_a_late_loop_acts_on_the_position_of_a_while_ago(steps: float):
    """What it asks for is stiffness (command - position `delay` ago), the command of now; in proportion in between."""
    robot = load_robot("servo_pendulum")
    h = 1 / robot.rate / robot.substeps(1 / robot.rate)
    sent, q, _, torque, stiffness, limit = witnessed("feedback_delay", [steps * h], lively()).T
    at = np.arange(10, len(q))
    late = np.interp(at - steps, np.arange(len(q)), q)
    asked = np.clip(stiffness[at] * (sent[at] - late), -limit[at], limit[at])
    np.testing.assert_allclose(torque[at], asked, atol=1e-9)
    assert rms(late - q[at]) > 1e-3


def test_a_log_that_begins_in_motion_was_in_motion_before():
    """A loop that sees late sees where the joint came from, at its first speed."""
    run = replace(lively(), initial=np.array([[0.3, 2.0]]))
    robot = load_robot("servo_pendulum")
    h = 1 / robot.rate / robot.substeps(1 / robot.rate)
    sent, _, _, torque, stiffness, limit = witnessed("feedback_delay", [4 * h], run)[0]
    assert torque == pytest.approx(np.clip(stiffness * (sent - (0.3 - 4 * h * 2.0)), -limit, limit))


def test_a_lagging_torque_follows_a_step_as_an_exponential():
    x, p = (
        Moment(h=np.array([[0.001]]), v=np.zeros((1, 1)), damping=np.zeros((1, 1))),
        {"time": np.array([[0.01]])},
    )
    asked = np.concatenate([np.zeros(5), np.ones(60)])
    given = np.array([float(E["torque_lag"].drive(np.array([[one]]), x, p)[0, 0]) for one in asked])
    since = np.arange(60) * 0.001
    mean = 1.0 - 10.0 * (np.exp(-since / 0.01) - np.exp(-(since + 0.001) / 0.01))  # of a time step
    np.testing.assert_allclose(given[:5], 0.0)
    np.testing.assert_allclose(given[5:], mean, atol=1e-12)


def test_a_lagging_torque_lags_with_the_back_emf_in_it():
    """At a constant speed nothing lags: what the motor gives is constant, its back-EMF taken off."""
    x = Moment(h=np.array([[0.001]]), v=np.full((1, 1), 3.0), damping=np.full((1, 1), 0.1))
    for _ in range(3):
        assert E["torque_lag"].drive(np.array([[0.7]]), x, {"time": np.array([[0.01]])})[
            0, 0
        ] == pytest.approx(0.7)


def test_a_profile_is_a_trapezoid_of_speed_that_ends_on_the_command():
    """A step of 1 rad at 2 rad/s and 20 rad/s^2 takes 1 / 2 + 2 / 20 s, and never overshoots."""
    h, speed, gain = 0.001, 2.0, 20.0
    x, p = Moment(h=np.array([[h]]), q=np.zeros((1, 1)), v=np.zeros((1, 1))), {}
    p = {"speed": np.array([[speed]]), "reach": np.array([[speed**2 / (2 * gain)]])}
    where = []
    for _ in range(800):
        E["profile_speed"].command(np.ones((1, 1)), x, p)
        where.append(float(x.memory["target"][0, 0]))
    rates = np.diff([0.0, *where]) / h
    assert max(where) <= 1.0 + 1e-9 and rates.max() == pytest.approx(speed)
    assert np.abs(np.diff([0.0, *rates])).max() <= gain * h * (1 + 1e-6)
    assert np.argmax(np.array(where) > 1.0 - 1e-6) * h == pytest.approx(1 / speed + speed / gain, abs=3 * h)


def test_a_profile_without_a_ramp_is_a_rate_limit():
    b = bench("servo_short")
    rate = np.array([[3.0]])
    nominal = b.robot.space.nominal[None]
    profile = Terms((Term(E["profile_speed"]),), (np.array([[3.0, 1e-6]]),))
    limit = Terms((Term(E["rate_limit"]),), (rate,))
    plain, one, other = (
        rollout(b.robot, nominal, b.run, engine=b.engine, terms=terms).states
        for terms in (None, profile, limit)
    )
    assert rms(one - other) < 1e-3 * rms(other - plain)


@pytest.mark.parametrize("key", ["motor_elasticity", "motor_backlash"])
def test_an_encoder_on_the_motor_hides_what_the_transmission_gives(key: str):
    """At rest on the load, log and joint differ by the load's torque times the compliance, or by half of the play;
    at first the log says what it is known to say, and the joint is where that leaves it.
    """
    robot = load_robot("servo_pendulum")
    size = {"motor_elasticity": 0.2, "motor_backlash": 0.05}[key]
    run = bench("servo").run.take([0])
    run = replace(run, actions=np.full((1, 150, 1), 0.8), initial=np.array([[0.8, 0.0]]), inputs=None)
    terms = Terms((Term(E[key]),), (np.array([[size]]),))
    nominal = robot.space.nominal[None]
    arena = Arena(robot, nominal, run, terms=terms)
    log, joint = arena.rollout(run).states[0, 0, :, 0], arena.poses(run)[0, 0, :, 0]
    holding = robot.space.as_dict(robot.space.nominal)["tip_mass"] * 9.80665 * 0.1 * np.sin(joint[-1])
    ahead = {"motor_elasticity": size * holding, "motor_backlash": 0.5 * size}[key]
    assert log[0] == 0.8
    assert log[-1] - joint[-1] == pytest.approx(ahead, rel=0.05)
    np.testing.assert_array_equal(log, arena.rollout(run).states[0, 0, :, 0])  # a second run starts anew
    found = rollout(robot, nominal, run, engine="joint", terms=terms).states[0, 0, :, 0]
    assert abs(found - log).max() < 0.15 * ahead


def test_no_play_and_no_compliance_are_the_plain_model_to_the_bit():
    for name in ("servo", "servo_mujoco"):
        b = bench(name)
        nominal = b.robot.space.nominal[None]
        plain = rollout(b.robot, nominal, b.run, engine=b.engine).states
        for key in ("motor_backlash", "motor_elasticity"):
            terms = Terms((Term(E[key]),), (np.zeros((1, 1)),))
            found = rollout(b.robot, nominal, b.run, engine=b.engine, terms=terms).states
            np.testing.assert_array_equal(found, plain)


def test_cogging_has_the_count_that_it_is_given():
    """On a stalled slow sweep the torque repeats `count` times a turn."""
    x, p = Moment(q=np.linspace(0, 2 * np.pi, 24 * 8 + 1)[:, None]), {}
    p = {"sine": np.array([[0.1]]), "cosine": np.array([[0.0]]), "count": np.array([[24.0]])}
    ripple = E["cogging"].drive(np.zeros_like(x.q), x, p)[:, 0]
    np.testing.assert_allclose(ripple[:-8], ripple[8:], atol=1e-12)
    assert np.abs(np.fft.rfft(ripple[:-1])).argmax() == 24


def test_limits_of_the_duty_are_for_servos_that_set_one():
    leg, servo = load_robot("leg"), load_robot("servo_pendulum")
    assert "torque_limit" in E["duty_limit"].why_not(leg)
    assert E["duty_limit"].why_not(servo) is None
    assert E["duty_limit"].about(servo, ()) == E["torque_limit"].about(servo, ()) == ("arm",)
    assert E["torque_limit"].about(leg, ("knee",)) is None  # there it is a cause of its own
    for key in ("feedback_delay", "profile_speed"):
        assert E[key].why_not(load_robot("double_pendulum")) is not None  # its drives are told torques


def test_an_encoder_that_runs_out_of_true_begins_where_the_log_says_in_both_engines():
    robot = load_robot("servo_pendulum")
    nominal, run = robot.space.nominal[None], replace(lively(), initial=np.array([[0.4, 1.0]]))
    terms = Terms((Term(E["encoder_eccentricity"]),), (np.array([[0.05, 0.03]]),))
    joint, mujoco, plain = (
        rollout(robot, nominal, run, engine=engine, terms=t).states[0, 0]
        for engine, t in (("joint", terms), ("mujoco", terms), ("joint", None))
    )
    assert joint[0] == pytest.approx([0.4, 1.0], abs=1e-3) and mujoco[0] == pytest.approx(
        [0.4, 1.0], abs=1e-3
    )
    assert rms(joint[:, 0] - mujoco[:, 0]) < 0.3 * rms(joint[:, 0] - plain[:, 0]) > 3e-3


@pytest.mark.parametrize("engine", ["joint", "mujoco"])
def test_a_free_joint_swings_from_the_speed_behind_what_its_encoder_says(engine: str):
    """With the drive off an encoder changes no motion: the log is that of the true start, read off."""
    robot, (sine, cosine) = load_robot("servo_pendulum"), (0.05, 0.03)
    read = lambda q: q + sine * np.sin(q) + cosine * np.cos(q)  # noqa: E731
    slope = lambda q: 1.0 + sine * np.cos(q) - cosine * np.sin(q)  # noqa: E731
    run = lively()
    off = run.inputs.copy()
    off[..., robot.inputs.index("arm/enabled")] = 0.0
    q, v = 0.4, 1.0
    begin = lambda angle, speed: replace(run, inputs=off, initial=np.array([[angle, speed]]))  # noqa: E731
    terms = Terms((Term(E["encoder_eccentricity"]),), (np.array([[sine, cosine]]),))
    nominal = robot.space.nominal[None]
    said = rollout(robot, nominal, begin(read(q), slope(q) * v), engine=engine, terms=terms).states[0, 0, :5]
    true = rollout(robot, nominal, begin(q, v), engine=engine).states[0, 0, :5]
    np.testing.assert_allclose(said[:, 0], read(true[:, 0]), atol=3e-3)
    np.testing.assert_allclose(said[:, 1], slope(true[:, 0]) * true[:, 1], atol=0.01)


def test_a_sliding_joint_has_no_disc():
    assert "slides" in E["encoder_eccentricity"].why_not(load_robot("emps"))


def test_beside_a_slide_hinges_may_have_discs_that_run_out_of_true(tmp_path: Path) -> None:
    copy = tmp_path / "arm"
    shutil.copytree(load_robot("two_joint_arm").folder, copy)
    text = (copy / "model.xml").read_text(encoding="utf-8")
    (copy / "model.xml").write_text(text.replace('name="elbow" arm', 'name="elbow" type="slide" arm'))
    robot, effect = load_robot(copy), E["encoder_eccentricity"]
    assert effect.why_not(robot) is None and [t.key for t in placed(robot, effect)] == [
        f"{effect.id}[shoulder]"
    ]
    for key in (effect.id, f"{effect.id}[elbow]", f"{effect.id}[shoulder,elbow]"):
        with pytest.raises(
            UsageError, match=r"a disc turns, and 'elbow' slides; expected joints out of 'shoulder'"
        ):
            require(robot, term(key))
    require(robot, term(f"{effect.id}[shoulder]"))
