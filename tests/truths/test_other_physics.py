"""Causes of other physics do what they are called after."""

import numpy as np
import pytest
from trials_of_truths import commands_of, told

from dynreg.sim.robot import load_robot
from dynreg.truths.arms import COLOUR, coloured
from dynreg.truths.causes import CAUSES
from dynreg.truths.drives import motor
from dynreg.truths.gears import bristles, dry
from dynreg.truths.rows import ROWS, STATE, plain
from dynreg.truths.table import KINDS, causes_of, log, sized
from dynreg.truths.truth import Commands, Truth

SERVO = "servo_pendulum"


def held(target: float, steps: int = 100, episodes: int = 1) -> Commands:
    """The servo told to stay at one angle."""
    actions = np.full((episodes, steps, 1), target)
    return Commands(actions, 0.01, np.arange(episodes) * (steps + 1) * 0.01)


def by_truth(commands: Commands, cause: str | None = None, **values: float) -> np.ndarray:
    space = load_robot(SERVO).space
    return log(Truth(SERVO, space.as_dict(space.nominal), cause, values, exact=True), commands)


def test_bristles_bend_before_they_slide():
    x, y = plain(1), np.zeros((len(STATE), 1))
    x[ROWS.index("coulomb")], x[ROWS.index("bend")] = 0.5, 0.01
    bound = dry(x, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    assert bound == pytest.approx(0.5)
    torque, _ = bristles(x, y, 0, 0.1, bound, 0.01, 1e-3)
    assert torque == pytest.approx(0.5 / 0.01 * 1e-4, rel=0.02), "a spring at first"
    for _ in range(3000):
        torque, _ = bristles(x, y, 0, 0.1, bound, 0.01, 1e-3)
    assert torque == pytest.approx(0.5, rel=1e-3), "dry friction in the end"


def test_bristles_let_a_stuck_joint_give_way():
    """Under a torque that friction holds, a joint with bristles moves a little, one with dry friction not at all."""
    # 5 mrad of command are 3.3 mN m, a sixth of the nominal dry friction
    still = by_truth(held(0.005))[0, :, 0]
    bent = by_truth(held(0.005), "dahl_friction", torque=0.01, bend=0.004)[0, :, 0]
    assert np.abs(still).max() < 1e-5 < 1e-4 < np.abs(bent).max() < 0.004


def test_an_encoder_on_the_motor_does_not_see_the_play():
    """The joint hangs against its flank: what the encoder reads is half the play beyond it."""
    commands = held(0.6, 300)
    reading = {c: by_truth(commands, c, gap=0.1)[0, -1, 0] for c in ("motor_backlash", "braked_backlash")}
    plainly = by_truth(commands)[0, -1, 0]
    # on the motor the servo holds its own angle; on the joint it holds the joint's: both near the plain reading
    assert reading["motor_backlash"] == pytest.approx(plainly, abs=0.03)
    # gravity at the joint is that of an angle half the play lower
    assert reading["motor_backlash"] - plainly > 1e-3
    assert abs(reading["braked_backlash"] - plainly) < abs(reading["motor_backlash"] - plainly)


@pytest.mark.parametrize(
    ("cause", "values"),
    [
        ("motor_backlash", {"gap": 1e-9}),
        ("motor_elasticity", {"compliance": 1e-9}),
        ("braked_elasticity", {"compliance": 1e-9}),
        ("feedback_delay", {"delay": 0.0}),
        ("torque_lag", {"time": 1e-7}),
        ("soft_stand", {"compliance": 1e-5}),
        ("encoder_eccentricity", {"sine": 0.0, "cosine": 0.0}),
        ("profile_speed", {"speed": 1e4, "acceleration": 1e8}),
    ],
)
def test_a_cause_without_size_changes_nothing(cause, values):
    assert told(SERVO, cause, values, 2)[..., 0] == pytest.approx(told(SERVO, episodes=2)[..., 0], abs=3e-3)


@pytest.mark.parametrize("name", [SERVO, "two_joint_arm", "diffdrive"])
def test_every_other_cause_shows(name):
    nothing = told(name, episodes=1)
    for cause in causes_of(name, "other"):
        changed = np.abs(told(name, cause, sized(name, cause, "strong", 1), 1) - nothing).max(axis=(0, 1))
        assert np.isfinite(changed).all() and changed.max() > 2e-3, cause


def test_late_feedback_makes_a_loop_swing():
    over = {d: by_truth(held(1.0, 200), "feedback_delay", delay=d)[0, :, 0].max() for d in (0.0, 0.016)}
    assert over[0.016] > over[0.0] + 0.01


def test_heat_builds_up_through_rests_and_the_librarys_does_not():
    commands = held(1.4, 250, 12)
    built = by_truth(commands, "heat_build_up", fade=0.9)[..., 0]
    warmed = by_truth(commands, "thermal_fade", fade=0.9)[..., 0]
    assert warmed[0] == pytest.approx(warmed[-1])
    assert np.abs(built[0] - built[-1]).max() > 0.01


def test_eccentricity_is_an_error_once_a_turn():
    commands = commands_of(SERVO, 2)
    reading = by_truth(commands, "encoder_eccentricity", sine=0.05, cosine=0.03)
    assert reading[:, 0, 0] == pytest.approx(commands.initial[:, 0]), "the log begins where it says"
    # at rest under its own weight alone, where the servo is told: the joint stands where the disc reads the target
    enabled = {"arm/enabled": np.zeros((1, 2000))}
    hanging = Commands(np.zeros((1, 2000, 1)), 0.01, np.zeros(1), np.array([[0.5, 0.0]]), enabled)
    for error in (0.0, 0.05):
        swings = by_truth(hanging, "encoder_eccentricity", sine=error, cosine=0.0)[0, :, 0]
        assert swings[0] == pytest.approx(0.5) and abs(swings[-1]) < 0.06


def test_a_patch_of_friction_holds_a_joint_where_it_is_and_nowhere_else():
    """Told to turn by a little: within the patch it stays, elsewhere it goes."""
    patch = {"torque": 0.5, "angle": 0.6, "width": 0.1}
    for begin, stays in ((0.6, True), (-0.6, False)):
        start = Commands(np.full((1, 60, 1), begin + 0.1), 0.01, np.zeros(1), np.array([[begin, 0.0]]))
        free = by_truth(start)[0, -1, 0] - begin
        rubbed = by_truth(start, "friction_patch", **patch)[0, -1, 0] - begin
        assert abs(free) > 0.02 and (abs(rubbed) < 0.3 * abs(free)) == stays


@pytest.mark.parametrize(("cause", "count"), [("cogging", 12), ("cogging_7", 7), ("cogging_24", 24)])
def test_cogging_pulls_to_as_many_places_as_it_says(cause, count):
    space = load_robot(SERVO).space
    values = dict.fromkeys(CAUSES[cause].sizes, 0.05) | {"count": 12.0}
    x = KINDS[SERVO].rows(Truth(SERVO, space.as_dict(space.nominal), cause, values), {})
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    torque = [motor(x, np.zeros((2, 1)), 0, 0.0, angle, 0.0, 0.0, 1.0, 1e-4) for angle in turn]
    assert np.abs(np.fft.rfft(torque)).argmax() == count


def test_coloured_noise_forgets_itself_as_it_says():
    noise = coloured(np.random.default_rng(1), (400, 200, 1), 0.01)[..., 0]
    lag = round(COLOUR / 0.01)
    assert noise.std() == pytest.approx(1.0, rel=0.05)
    assert (noise[:, :-lag] * noise[:, lag:]).mean() == pytest.approx(np.exp(-1), abs=0.06)


def test_a_cable_ties_two_joints():
    apart = (
        told("two_joint_arm", episodes=2),
        told("two_joint_arm", "cable_coupling", {"stiffness": 200.0}, 2),
    )
    free, tied = (np.abs(states[..., 0] - states[..., 1])[:, 50:].mean() for states in apart)
    assert tied < 0.5 * free


def test_a_cause_can_sit_in_one_joint():
    # the other joint moves only because the arm does
    nothing = told("two_joint_arm", episodes=2)
    one = told("two_joint_arm", "force_offset", {"torque": 0.5}, 2, joints=("elbow",)) - nothing
    both = told("two_joint_arm", "force_offset", {"torque": 0.5}, 2) - nothing
    assert np.abs(one[..., 1]).mean() > 2 * np.abs(one[..., 0]).mean()
    assert np.abs(both[..., 0]).mean() > 2 * np.abs(one[..., 0]).mean()
