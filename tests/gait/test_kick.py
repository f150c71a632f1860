"""Bodies beside the robot: where they go is tracked, and a kick is scored by it."""

import re
from pathlib import Path

import numpy as np
import pytest
import toy_dog

from dynreg.errors import RobotError
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import Kick, Slope, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.sim.effects.contact import has_ground, left_feet
from dynreg.sim.gait_tables import TaskTable
from dynreg.sim.inspection import check_robot
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Walk

MORE = '[[motions]]\nname = "kick"\n[[tasks]]\nname = "kick"\nkind = "kick"\nmotion = "kick"\nseconds = 2.0\n'


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder = tmp_path_factory.mktemp("robots") / "dog"
    return load_robot(toy_dog.folder(folder, toy_dog.walking(), MORE, ball=True))


@pytest.fixture(scope="module")
def trials(dog: Robot) -> Trials:
    return Trials(dog, task_of(dog, "kick"), Simulators(dog.space.nominal[None]), rate=dog.rate, threads=1)


def motions(trials: Trials) -> np.ndarray:
    """Standing still, a kick of the leg behind the ball, and one of the leg beside it."""
    still = trials.space.as_dict(trials.space.rest) | {"points": 8.0}
    swung = {"rotor_1": -1.0, "knee_1": 1.9, "rotor_2": 0.5, "knee_2": 0.4}
    kicks = [still | {f"{leg}_{name}": angle for name, angle in swung.items()} for leg in ("fl", "fr")]
    genes = np.array([trials.space.from_dict(one) for one in (still, *kicks)])
    return trials.space.feasible(genes)


def test_a_ball_rolls_where_it_is_kicked_and_lies_where_it_is_not(trials) -> None:
    genes = motions(trials)
    walk = trials.walk(genes, feet=True)
    assert walk.bodies.shape == (1, 3, len(trials.times) + 1, 1, 3)
    first, last = walk.bodies[0, :, 0, 0], walk.bodies[0, :, -1, 0]
    assert np.allclose(first, [0.125, 0.081, 0.03], atol=1e-3)
    assert last[1, 0] - first[1, 0] > 0.3 and np.abs(last[[0, 2]] - first[[0, 2]]).max() < 0.01
    grades = trials.task.grade(walk)[0]
    assert grades[1] > 0.3 and np.abs(grades[[0, 2]]).max() < 0.01
    alone = np.concatenate([trials.walk(one[None]).bodies for one in genes], axis=1)
    assert np.array_equal(alone, walk.bodies)
    assert sorted(walk.contact) == ["fl_foot", "fr_foot", "rl_foot", "rr_foot"]  # the ball is no foot


def test_a_ball_lies_still_in_the_account_once_the_robot_fell(trials) -> None:
    tipped = trials.space.as_dict(motions(trials)[1]) | {"points": 12.0}
    tipped |= {f"{leg}_elevator_{p}": 1.5 for leg in ("fl", "rl") for p in (1, 2)}
    tipped |= {f"{leg}_rotor_{p}": -2.0 for leg in ("fr", "rr") for p in (1, 2)}
    walk = trials.walk(trials.space.feasible(trials.space.from_dict(tipped)[None]))
    end = int(walk.fell[0, 0])
    assert end < len(trials.times)
    assert np.array_equal(
        walk.bodies[0, 0, end:], np.repeat(walk.bodies[0, 0, end - 1 : end], len(trials.times) + 1 - end, 0)
    )


def rolled(x: float, y: float, yaw: float = 0.0) -> Walk:
    base, bodies = np.zeros((1, 1, 11, 12)), np.zeros((1, 1, 11, 2, 3))
    base[..., 5] = yaw
    bodies[0, 0, :, 0, :2] = 5.0 + np.outer(np.linspace(0, 1, 11), [x, y])
    return Walk(base, np.array([[11]]), 0, bodies=bodies)


def test_a_kick_is_worth_its_length_less_for_an_angle() -> None:
    ahead, aside = (
        Kick(TaskTable(name="k", values={"direction": direction})) for direction in (0.0, np.pi / 2)
    )
    of = lambda task, *way: float(task.grade(rolled(*way))[0, 0])  # noqa: E731
    assert of(ahead, 2.0, 0.0) == pytest.approx(2.0) and of(aside, 0.0, 2.0) == pytest.approx(2.0)
    assert of(ahead, np.cos(0.3), np.sin(0.3)) == pytest.approx(np.exp(-5 * 0.09))
    assert of(ahead, np.cos(0.3), -np.sin(0.3)) == pytest.approx(np.exp(-5 * 0.09))
    assert of(ahead, 0.0, 1.0, np.pi / 2) == pytest.approx(1.0)  # as the robot looks at the start
    assert of(ahead, -1.0, 0.0) < 1e-10 and of(ahead, 0.0, 0.0) == 0.0
    unseen = Walk(np.zeros((1, 1, 11, 12)), np.array([[11]]), 0)
    assert np.isnan(ahead.grade(unseen)).all()


def test_a_trial_on_a_simulated_robot_tells_where_the_ball_went(dog, trials) -> None:
    real = SimulatedRobot(dog, dog.space.nominal, seed=1)
    trial = real.run(trials.space.targets(motions(trials)[1:2], trials.times)[0], dog.rate)
    assert trials.task.grade(trial.walk)[0, 0] > 0.2


def laid(ahead: float, left: float) -> Kick:
    values = {"ahead": ahead, "left": left}
    return Kick(TaskTable(name="kick", kind="kick", motion="kick", seconds=2.0, values=values))


def test_a_ball_lies_where_the_task_says_and_else_where_the_model_has_it(dog, trials) -> None:
    assert trials.task.laid() is None
    simulators = Simulators(np.tile(dog.space.nominal, (2, 1)))
    told = {"rate": dog.rate, "threads": 1}
    moved = Trials(dog, laid(0.2, -0.15), simulators, **told).walk(motions(trials))
    assert np.allclose(moved.bodies[:, :, 0, 0, :2], [0.2, -0.15])
    assert np.allclose(moved.bodies[:, 0, -1, 0], [0.2, -0.15, 0.03], atol=1e-3), "nothing kicks it"
    usual = trials.walk(motions(trials)).bodies[0, :, 0, 0, :2]
    same = Trials(dog, laid(*usual[0]), simulators, **told).grades(motions(trials))
    assert same[:, 0] == pytest.approx(trials.grades(motions(trials))[:, 0], abs=0.02)


def test_a_simulated_robot_s_ball_lies_where_it_is_laid(dog, trials) -> None:
    still = trials.space.targets(motions(trials)[:1], trials.times)[0]
    real = SimulatedRobot(dog, dog.space.nominal, seed=1, laid=np.array([[0.2, -0.15]]))
    assert real.run(still, dog.rate).walk.bodies[0, 0, -1, 0, :2] == pytest.approx([0.2, -0.15], abs=1e-3)


def test_the_keyframe_s_place_and_heading_are_where_the_robot_starts(dog, trials, tmp_path) -> None:
    """Scenery and balls stay where the model has them; ahead is where the robot looks."""
    folder = toy_dog.folder(tmp_path / "dog", toy_dog.walking(), MORE, ball=True)
    text = (folder / "model.xml").read_text()
    for old, new in (
        ('qpos="0 0 0.14 1 0 0 0', 'qpos="1 2 0.14 1 0 0 1'),
        (" 0.125 0.081 0.03 1", " 0.919 2.125 0.03 1"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "model.xml").write_text(text)
    moved, genes = load_robot(folder), motions(trials)[1:2]
    told = {"rate": dog.rate, "threads": 1}
    for task in (
        trials.task,
        laid(0.125, 0.081),
        Slope(TaskTable(name="up", motion="kick", seconds=2.0, values={"angle": 0.2})),
    ):
        usual, there = (
            Trials(robot, task, Simulators(dog.space.nominal[None]), **told).walk(genes)
            for robot in (dog, moved)
        )
        first, turned = there.base[0, 0, 0], np.moveaxis(usual.base[0, 0], -1, 0)
        assert first[[0, 1]] == pytest.approx([1.0, 2.0]) and first[5] == pytest.approx(np.pi / 2, abs=1e-3)
        assert there.base[0, 0, :, 0] == pytest.approx(1.0 - turned[1], abs=2e-3)
        assert there.base[0, 0, :, 1] == pytest.approx(2.0 + turned[0], abs=2e-3)
        assert task.grade(there) == pytest.approx(task.grade(usual), abs=0.01)
        ball = usual.bodies[0, 0, :, 0]
        assert there.bodies[0, 0, 0, 0, :2] == pytest.approx([1.0 - ball[0, 1], 2.0 + ball[0, 0]], abs=1e-3)


def test_half_a_place_is_refused() -> None:
    with pytest.raises(RobotError, match="task 'k': left alone; expected ahead and left"):
        Kick(TaskTable(name="k", values={"left": 0.1}))


def test_a_ball_is_no_foot_of_the_left_side(dog, tmp_path) -> None:
    bare = load_robot(toy_dog.folder(tmp_path / "dog", toy_dog.walking(), MORE))
    names = [[robot.model.geom(int(g)).name for g in left_feet(robot)] for robot in (bare, dog)]
    assert names[0] == ["fl_foot", "rl_foot"]
    assert names[1] and all(name.startswith(("fl_", "rl_")) or not name for name in names[1])
    left = {dog.model.body(int(dog.model.geom_bodyid[g])).name for g in left_feet(dog)}
    assert left == {f"{leg}_{part}" for leg in ("fl", "rl") for part in ("upper", "lower")}
    assert has_ground(dog)


def test_robots_without_such_bodies_have_none_and_no_kick(tmp_path, quadruped) -> None:
    bare = Trials(
        quadruped, task_of(quadruped), Simulators(quadruped.space.nominal[None]), rate=36.0, threads=1
    )
    assert bare.walk(bare.space.feasible(bare.space.from_unit(bare.space.starts[:1]))).bodies is None
    robot = load_robot(toy_dog.folder(tmp_path / "dog", toy_dog.walking(), MORE))
    with pytest.raises(RobotError, match="task 'kick' scores 1 tracked bodies, robot 'dog' has 0"):
        task_of(robot, "kick")


def test_the_kick_of_the_page_scores_its_ball(tmp_path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "gait.md").read_text(encoding="utf-8")
    (block,) = [one for one in re.findall(r"```toml\n(.*?)```", page, re.DOTALL) if "[[motions]]" in one]
    assert '`tracked = ["ball"]`' in page and "[robot]" not in block, "a file has that table already"
    robot = load_robot(toy_dog.folder(tmp_path / "dog", toy_dog.walking(), block, ball=True))
    task = task_of(robot, "kick")
    assert isinstance(task, Kick) and gait_space(robot, task.motion).names[:2] == ("fl_rotor_1", "fl_knee_1")


def test_a_body_that_is_not_there_is_refused(tmp_path) -> None:
    folder = toy_dog.folder(tmp_path / "dog", toy_dog.walking(), MORE, ball=True)
    path = folder / "robot.toml"
    path.write_text(path.read_text().replace('["ball"]', '["trunk"]'))
    robot = load_robot(folder)
    line = path.read_text().splitlines().index('tracked = ["trunk"]') + 1
    (told,) = check_robot(folder)
    assert told.startswith(f"robot.toml, line {line}: tracked body 'trunk' is not beside the robot")
    with pytest.raises(RobotError, match=r"tracked body 'trunk'.*'ball'"):
        Trials(robot, task_of(robot, "kick"), Simulators(robot.space.nominal[None]), rate=robot.rate).walk(
            np.zeros((1, 25))
        )
