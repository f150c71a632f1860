"""Drives of type pid: a position drive with an integral part, alike on both engines."""

from pathlib import Path

import numpy as np
import pytest
from effect_benches import rms

from dynreg.errors import RobotError
from dynreg.sim.effects import Term, Terms, effects
from dynreg.sim.engines import rollout
from dynreg.sim.inspection import check_robot
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

ENGINES = ("joint", "mujoco")
KEYS = ("gain", "integral_gain", "rate_gain", "torque_limit", "speed_limit")
LOOP = {"gain": 4.0, "integral_gain": 12.0, "rate_gain": 0.15, "torque_limit": 1.6, "speed_limit": 9.0}
MASS, LENGTH, INERTIA, VISCOUS = (
    0.49,
    0.1,
    0.49 * 0.1**2 + 1e-6 + 0.0018,
    0.006,
)  # of servo_pendulum, without dry friction
WEIGHT = MASS * 9.80665 * LENGTH

TOML = """
[robot]
name = "pid_pendulum"
engines = ["joint", "mujoco"]
control_rate = 125.0
timestep = {timestep}

[[drives]]
joint = "arm"
type = "{kind}"
enable = "arm/enabled"
{loop}

[[actions]]
name = "arm/target"
unit = "rad"
low = -3.1416
high = 3.1416

[[channels]]
name = "arm/position"
unit = "rad"
noise = 0.0005

[[channels]]
name = "arm/velocity"
unit = "rad/s"
noise = 0.02

[[parameters]]
name = "viscous_friction"
unit = "N*m*s/rad"
nominal = 0.006
low = 0.001
high = 0.03
sets = ["port.friction.viscous[arm] ="]
"""
SET = """
[[parameters]]
name = "{key}"
unit = "1"
nominal = {nominal}
low = {low}
high = {high}
sets = ["port.drive.{key}[arm] ="]
"""


def written(folder: Path, *, kind: str = "pid", timestep: float = 0.001, keys=KEYS, **loop: object) -> Path:
    """The pendulum with a drive of these numbers, which are all parameters too."""
    loop = {k: v for k, v in (LOOP | loop).items() if k in keys or k not in KEYS}
    text = TOML.format(timestep=timestep, kind=kind, loop="\n".join(f"{k} = {v}" for k, v in loop.items()))
    numbers = {k: v for k, v in loop.items() if k in KEYS and v >= 0}
    for key, value in numbers.items():
        text += SET.format(key=key, nominal=value, low=0.5 * value, high=2.0 * value + 1e-6)
    (folder / "robot.toml").write_text(text)
    model = load_robot("servo_pendulum").files.files["model.xml"]
    named = b'<joint name="arm" armature="0.0018"'
    (folder / "model.xml").write_bytes(model.replace(b'<joint name="arm"', named))
    return folder


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return load_robot(written(tmp_path))


def steps(target: float, *, count: int = 150, episodes: int = 1) -> Run:
    """A step of the target, from rest at the bottom."""
    return Run(np.full((episodes, count, 1), target), initial=np.zeros((episodes, 2)))


def moved(
    robot: Robot, run: Run, engine: str, *terms: tuple[str, list[float]], **changed: float
) -> np.ndarray:
    """(T+1, S) of the first episode, with other parameters and effects."""
    values = robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | changed)[None]
    made = Terms(tuple(Term(effects()[k]) for k, _ in terms), tuple(np.array([v]) for _, v in terms))
    return rollout(robot, values, run, engine=engine, threads=1, terms=made if terms else None).states[0, 0]


def textbook(run: Run, period: float, fine: int, **changed: float) -> np.ndarray:
    """(T+1, 2) of the loop and the pendulum by midpoint steps of period / fine: nothing of dynreg in it."""
    loop = LOOP | changed
    h, integral = period / fine, 0.0
    q, v = run.initial[0]
    out = [(q, v)]

    def slope(q: float, v: float, integral: float, target: float) -> tuple[float, float, float]:
        error = target - q
        asked = loop["gain"] * error + loop["integral_gain"] * integral - loop["rate_gain"] * v
        most = loop["torque_limit"] * min(max(1.0 - v / loop["speed_limit"], 0.0), 1.0)
        least = -loop["torque_limit"] * min(max(1.0 + v / loop["speed_limit"], 0.0), 1.0)
        stuck = (asked > most and error > 0) or (asked < least and error < 0)
        torque = min(max(asked, least), most)
        return v, (torque - WEIGHT * np.sin(q) - VISCOUS * v) / INERTIA, 0.0 if stuck else error

    for (target,) in run.actions[0]:
        for _ in range(fine):
            a = slope(q, v, integral, target)
            b = slope(q + h / 2 * a[0], v + h / 2 * a[1], integral + h / 2 * a[2], target)
            q, v, integral = q + h * b[0], v + h * b[1], integral + h * b[2]
        out.append((q, v))
    return np.array(out)


@pytest.mark.parametrize(("engine", "tolerance"), [("joint", 0.005), ("mujoco", 0.02)])
@pytest.mark.parametrize("target", [0.3, 1.2, 2.6])
def test_a_step_is_that_of_a_textbook_integration(robot: Robot, engine: str, tolerance: float, target: float):
    """Within this share of the motion, free of its limits (0.3 rad), and long held by both (2.6 rad)."""
    run = steps(target)
    truth, found = textbook(run, 0.008, 80), moved(robot, run, engine)
    assert rms(found[:, 0] - truth[:, 0]) < tolerance * rms(truth[:, 0])
    assert rms(found[:, 1] - truth[:, 1]) < tolerance * 2 * rms(truth[:, 1])


def test_engines_agree_on_what_the_integral_part_does(robot: Robot):
    run = steps(1.2)
    changes = [moved(robot, run, e) - moved(robot, run, e, integral_gain=6.0) for e in ENGINES]
    assert rms(changes[0] - changes[1]) < 0.1 * rms(changes[0])


@pytest.mark.parametrize("engine", ENGINES)
def test_the_integral_part_takes_away_what_gravity_leaves_of_the_error(tmp_path: Path, engine: str):
    """A position drive rests where its spring holds the weight; this one on its target."""
    run = steps(1.0, count=750)
    last = moved(load_robot(written(tmp_path)), run, engine)[-1]
    np.testing.assert_allclose(last, [1.0, 0.0], atol=1e-4)
    keys = tuple(k for k in KEYS if k != "integral_gain")
    sagged = moved(load_robot(written(tmp_path, kind="position", keys=keys)), run, engine)[-1, 0]
    assert LOOP["gain"] * (1.0 - sagged) == pytest.approx(WEIGHT * np.sin(sagged), rel=1e-3)
    assert 1.0 - sagged > 0.05


@pytest.mark.parametrize("engine", ENGINES)
def test_without_an_integral_gain_it_is_a_position_drive(tmp_path: Path, engine: str):
    run = steps(1.2)
    keys = tuple(k for k in KEYS if k != "integral_gain")
    same = [moved(load_robot(written(tmp_path, kind=k, keys=keys)), run, engine) for k in ("pid", "position")]
    np.testing.assert_array_equal(*same)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_speed_limit_without_a_torque_limit_limits_nothing(tmp_path: Path, engine: str):
    """On its way up the pendulum is faster than 1 rad/s, and the integral grows all the same."""
    run, (free, slow) = steps(2.0), (tuple(k for k in KEYS if k not in out) for out in (KEYS[3:], KEYS[3:4]))
    plain = moved(load_robot(written(tmp_path, keys=free)), run, engine)
    assert plain[:, 1].max() > 2.0
    limited = moved(load_robot(written(tmp_path, keys=slow, speed_limit=1.0)), run, engine)
    np.testing.assert_array_equal(limited, plain)


@pytest.mark.parametrize("engine", ENGINES)
def test_long_saturation_winds_nothing_up(robot: Robot, engine: str):
    """Too weak for the weight at its target, it hangs at 1 rad for 4 s; then it comes to a target below at once.

    With an integral that grew all the time, 14 N m, it would stay up there for 4 s more.
    """
    told = np.concatenate([np.full(500, 1.57), np.full(250, 0.4)])
    run = Run(told[None, :, None], initial=np.zeros((1, 2)))
    q = moved(robot, run, engine, torque_limit=0.8 * WEIGHT)[:, 0]
    assert q[500] == pytest.approx(np.arcsin(0.8), abs=0.01)
    assert q[500:].max() < q[500] + 0.01
    assert np.abs(q[600:] - 0.4).max() < 0.05


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("key", KEYS)
def test_every_key_is_set_by_port_drive_and_has_a_slope(robot: Robot, engine: str, key: str):
    """A change of 2 % does twice what one of 1 % does: a fit can follow. The step meets both limits."""
    run, nominal = steps(2.6), LOOP[key]
    plain = moved(robot, run, engine)
    one, two = (rms(moved(robot, run, engine, **{key: nominal * (1 + x)}) - plain) for x in (0.01, 0.02))
    assert one > 1e-4
    assert 1.6 < two / one < 2.4


@pytest.mark.parametrize("engine", ENGINES)
def test_effects_meet_the_integral_part_too(robot: Robot, engine: str):
    """What the encoder reads comes to the target, whatever its zero; a stronger loop is one of larger gains."""
    run = steps(0.8, count=750)
    off = moved(robot, run, engine, ("encoder_offset", [0.1]))
    assert off[-1, 0] == pytest.approx(0.8, abs=1e-3)  # the log holds the reading
    short = steps(0.5)
    stronger = moved(robot, short, engine, ("drive_gain", [0.25]))
    larger = {k: 1.25 * LOOP[k] for k in ("gain", "integral_gain", "rate_gain")}
    np.testing.assert_allclose(stronger, moved(robot, short, engine, **larger), atol=1e-9)
    weaker = moved(robot, steps(2.6), engine, ("torque_limit", [0.25]))
    np.testing.assert_allclose(weaker, moved(robot, steps(2.6), engine, torque_limit=1.2), atol=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_drive_that_is_switched_on_begins_its_integral_anew(robot: Robot, engine: str):
    """Off for 1 s with an error of 0.5 rad: it hangs at the bottom, and its first torque is that of a new loop."""
    told = np.full((2, 200, 1), 0.5)
    on = np.ones((2, 200, 1))
    on[0, :125] = 0.0
    run = Run(told, on, initial=np.zeros((2, 2)))
    late, fresh = rollout(robot, robot.space.nominal[None], run, engine=engine, threads=1).states[0]
    np.testing.assert_allclose(late[125:], fresh[:76], atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"integral_gain": -1.0}, "integral_gain"),
        ({"gain": 0.0}, "gain"),
        ({"rate_gain": -0.1}, "rate_gain"),
        ({"torque_limit": 0.0}, "torque_limit"),
        ({"speed_limit": -2.0}, "speed_limit"),
        ({"frame": -0.008}, "frame"),
    ],
)
def test_bad_numbers_are_told_with_their_line(tmp_path: Path, changed: dict, said: str):
    with pytest.raises(RobotError, match=f"line .*{said}") as told:
        load_robot(written(tmp_path, **changed))
    assert "\n" not in str(told.value)


def test_a_folder_with_a_pid_drive_is_checked_clean(tmp_path: Path):
    assert check_robot(written(tmp_path)) == []
