"""Gaits by the way of the feet: MuJoCo's feet are where they were asked to be, limits are kept, and it walks."""

import mujoco
import numpy as np
import pytest
import toy_dog

from dynreg.errors import RobotError
from dynreg.gait.locus import STANCE
from dynreg.gait.seek import SearchSettings, seek
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot

FINE = np.linspace(0.0, 3.0, 3001)


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(toy_dog.folder(tmp_path_factory.mktemp("robots") / "dog", toy_dog.walking()))


@pytest.fixture(scope="module")
def space(dog: Robot):
    return gait_space(dog)


def by_hand(space, **other: float) -> np.ndarray:
    """A slow trot below the pose at rest."""
    known = {"length": 0.05, "speed": 0.12, "lift": 0.02, "shape": 0.5, "air": 0.5, "lift_time": 0.25}
    rest = {name: value for name, value in space.as_dict(space.rest).items() if np.isfinite(value)}
    middle = space.as_dict(space.bounds.mean(axis=1))
    return space.from_dict({**middle, **rest, **known, "points": 12.0, **other})


def drawn(space, count: int, seed: int = 0) -> np.ndarray:
    return space.from_unit(stream(seed, "loci").uniform(size=(count, len(space))))


def feet(robot: Robot, pose: np.ndarray) -> np.ndarray:
    """(4, 3) where MuJoCo has the feet in the trunk's frame [m], with joints (A,)."""
    model, data = robot.model, mujoco.MjData(robot.model)
    for name, angle in zip(robot.joints, pose, strict=True):
        data.qpos[model.jnt_qposadr[model.joint(name).id]] = angle
    data.qpos[3:7] = 0.8, 0.36, 0.48, 0.0  # however the trunk lies
    mujoco.mj_kinematics(model, data)
    trunk = model.body("trunk").id
    places = np.array([data.geom(f"{leg}_foot").xpos for leg in ("fl", "fr", "rl", "rr")])
    return (places - data.xpos[trunk]) @ data.xmat[trunk].reshape(3, 3)


def test_it_has_the_papers_twenty_genes(space) -> None:
    assert len(space) == 20 == len({*space.names})
    assert [sum(name.startswith(end) for name in space.names) for end in ("front_", "rear_")] == [6, 6]


def test_the_feet_are_where_they_were_asked_to_be_by_mujocos_kinematics(dog, space) -> None:
    genes = space.feasible(drawn(space, 4))
    _, points = space.ways(genes)
    for gait in range(len(genes)):
        for k in range(0, points.shape[2], 5):
            pose = np.empty(len(space.actions))
            for i, leg in enumerate(space.legs):
                pose[space.columns[i]] = leg.angles(points[gait, i, k])
            assert np.abs(feet(dog, pose) - points[gait, :, k]).max() < 1e-9


def test_a_foot_on_the_ground_goes_straight_back_at_the_speed(dog, space) -> None:
    """Between two points of the way the joints turn evenly: the foot leaves its line by less than 0.1 mm."""
    genes = by_hand(space)
    stance = 0.05 / 0.12
    times = 5 / space.frequency(genes) + np.linspace(0.05, 0.95, 20) * stance  # after the ramp
    places = np.array([feet(dog, pose)[0] for pose in space.targets(genes[None], times)[0]])
    away = places - places[0]
    assert np.abs(away[:, 0] + 0.12 * (times - times[0])).max() < 1e-4
    assert np.abs(away[:, 1:]).max() < 1e-4


def test_the_shape_leads_from_a_rectangle_to_half_an_ellipse(space) -> None:
    """At the knots of the spline, in shares of the length and the lift: 20 points in the air, a knot at every fifth."""
    genes = np.stack([by_hand(space, shape=shape, points=20.0) for shape in (0.0, 1.0)])
    _, points = space.ways(genes)
    middle = points[:, 0, : STANCE + 1].mean(axis=1, keepdims=True)
    ahead, up = np.moveaxis((points[:, 0, STANCE::5] - middle)[..., [0, 2]] / [0.05, 0.02], -1, 0)
    assert np.allclose(ahead[0], [-0.5, -0.5, 0.0, 0.5, 0.5]) and np.allclose(up[0], [0, 1, 1, 1, 0])
    assert np.allclose((2 * ahead[1]) ** 2 + up[1] ** 2, 1.0) and (np.diff(ahead[1]) > 0.1).all()


@pytest.mark.parametrize("seed", range(4))
def test_what_is_made_feasible_keeps_every_limit_at_every_time(seed: int, space) -> None:
    wild = drawn(space, 6, seed)
    genes = space.feasible(wild)
    assert not np.allclose(genes, wild) and all(space.problems(g) == () for g in genes)
    told = space.targets(genes, FINE)
    assert np.allclose(told[:, 0], space.pose)
    assert (told >= space.low - 1e-9).all() and (told <= space.high + 1e-9).all()
    assert (np.abs(np.diff(told, axis=1)) / FINE[1] <= space.speed + 1e-6).all()
    assert len(space.feasible(genes[:0])) == len(space.targets(genes[:0], FINE)) == 0
    assert np.allclose(space.feasible(genes), genes)  # what is feasible stays as it is


def test_a_place_that_no_foot_reaches_is_told_and_the_locus_shrinks(space) -> None:
    genes = by_hand(space, length=0.1, front_x=space.bounds[space.names.index("front_x"), 1], front_z=-0.14)
    assert any("the foot of leg 'fl' would miss its way by" in problem for problem in space.problems(genes))
    made = space.as_dict(space.feasible(genes[None])[0])
    assert made["length"] < 0.1 and made["front_z"] > -0.14 and made["speed"] == pytest.approx(0.12)


def test_what_is_too_fast_is_slowed_and_keeps_its_way(space) -> None:
    genes = by_hand(space, speed=0.4)
    *turns, steps = space.problems(genes)
    assert turns[0] == "fl_knee/target would turn at 17.95 rad/s, past its limit 12.00"
    assert steps == "each leg would step 4.00 times a second, past 3"
    made = space.as_dict(space.feasible(genes[None])[0])
    assert made["speed"] < 0.4 and made["length"] == pytest.approx(0.05)


@pytest.fixture(scope="module")
def trials(dog: Robot) -> Trials:
    return Trials(dog, task_of(dog), Simulators(dog.space.nominal[None]), rate=dog.rate, threads=1)


def test_it_walks_ahead_on_the_ground_and_turns_with_skew(space, trials) -> None:
    genes = np.stack([by_hand(space), by_hand(space, skew=1.5), by_hand(space, skew=-1.5)])
    walk = trials.walk(space.feasible(genes))
    ahead, _, yaw = walk.base[0, :, -1, [0, 1, 5]]
    assert (walk.fell == len(trials.times) + 1).all()
    assert ahead[0] > 0.4
    assert yaw[1] > 0.3 + yaw[0] and yaw[2] < yaw[0] - 0.3


def test_it_walks_back_with_a_length_below_zero(tmp_path) -> None:
    gait = toy_dog.walking("ranges = { length = [-0.08, -0.02] }\n").replace(
        "seconds = 10.0", "seconds = 4.0"
    )
    robot = load_robot(toy_dog.folder(tmp_path / "dog", gait))
    trials = Trials(robot, task_of(robot), Simulators(robot.space.nominal[None]), rate=robot.rate, threads=1)
    walk = trials.walk(trials.space.feasible(by_hand(trials.space, length=-0.05)[None]))
    assert walk.base[0, 0, -1, 0] < -0.1


def test_searches_know_the_family_by_its_protocol_alone(tmp_path) -> None:
    start = "[[gait.start]]\nlength = 0.05\nspeed = 0.12\nlift = 0.02\n"
    gait = toy_dog.walking(start).replace("seconds = 10.0", "seconds = 1.0")
    robot = load_robot(toy_dog.folder(tmp_path / "dog", gait))
    trials = Trials(robot, task_of(robot), Simulators(robot.space.nominal[None]), rate=robot.rate, threads=1)
    found = seek(trials, SearchSettings(rollouts=22, seed=1))
    assert trials.space.problems(found.genes) == () and found.fitness[0] > 0.0
    about = trials.space.from_unit(trials.space.about_rest(200, stream(1, "rest")))
    standing = trials.space.rest
    at = np.isfinite(standing)
    assert at.sum() == 7 and np.allclose(np.median(about[:, at], axis=0), standing[at], atol=0.1)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("ramp = 0.5", 'ramp = 0.5\nranges = { height = [0.0, 1.0] }', "ranges names 'height'.*'front_z'"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { length = [-0.1, 0.1] }", "in which 0 lies"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { speed = [-0.1, 0.5] }", r"speed = \[-0.1, 0.5\].*above 0;"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { speed = [0.0, 0.5] }", r"speed = \[0, 0.5\].*above 0;"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { air = [0.2, 1.0] }", r"air = \[0.2, 1\].*above 0 and below 1;"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { air = [0.0, 0.5] }", r"air = \[0, 0.5\].*above 0 and below 1;"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { lift_time = [0.1, 0.5] }", "lift_time = .*above 0 and below 0.5;"),
        ("ramp = 0.5", "ramp = 0.5\nranges = { points = [0.2, 3.0] }", r"points = \[0.2, 3\].*at least 1 point"),
        ("ramp = 0.5", "ramp = 0.5\nstart = { length = 3.0 }", "start: length = 3.0"),
        ('rotor = "fl_rotor", elevator = "fl_e', 'elevator = "fl_rotor", rotor = "fl_e', "does not turn"),
        ('name = "rotor"', 'name = "roll"', "legs with roles"),
    ],
)  # fmt: skip
def test_a_table_that_does_not_fit_is_refused(old: str, new: str, says: str, tmp_path) -> None:
    gait = toy_dog.walking().replace(old, new)
    if old.startswith("name"):
        gait = gait.replace("rotor =", "roll =")
    with pytest.raises(RobotError, match=says):
        gait_space(load_robot(toy_dog.folder(tmp_path / "dog", gait)))


def test_a_robot_whose_hips_come_first_is_no_such_leg(brief_folder, tmp_path) -> None:
    import re
    import shutil

    shutil.copytree(brief_folder, tmp_path / "own")
    path = tmp_path / "own" / "robot.toml"
    text = re.sub(r"\[\[gait\.start\]\][^\[]*|^(amplitude|offset) = \[.*\n", "", path.read_text(), flags=re.M)
    text = text.replace("frequency = [0.5, 2.5]", 'kind = "locus"')
    for old, new in (("hip", "rotor"), ("shoulder", "elevator"), ("elbow", "knee")):
        text = text.replace(f'name = "{old}"', f'name = "{new}"').replace(f'["{old}"]', f'["{new}"]')
        text = re.sub(rf"\b{old} = ", f"{new} = ", text)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RobotError, match="'fl_hip' does not turn about the lateral axis"):
        gait_space(load_robot(tmp_path / "own"))
