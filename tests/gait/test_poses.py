"""Motions through poses: the paper's kick, joints that follow others, limits, and what is refused."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import toy_dog

from dynreg.errors import RobotError, UsageError
from dynreg.gait.play import joints, require_own
from dynreg.gait.poses import Poses
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream
from dynreg.sim.robot import load_robot

FINE = np.linspace(0.0, 3.0, 3001)
KICK = '[[motions]]\nname = "kick"\n'
TASK = '[[tasks]]\nname = "lean"\nmotion = "kick"\nseconds = 1.5\n'
PAIRS = """joints = ["fl_rotor", "fl_knee"]
mirrored = { fr_rotor = "fl_rotor" }
together = { fr_knee = "fl_knee" }
"""


def space_of(folder: Path, motion: str = KICK) -> Poses:
    return gait_space(load_robot(toy_dog.folder(folder / "dog", motion, TASK)), "kick")


def drawn(space: Poses, count: int) -> np.ndarray:
    return space.from_unit(stream(3, "poses").uniform(size=(count, len(space))))


def test_a_kick_of_four_legs_through_two_poses_has_the_papers_twenty_five_genes(tmp_path) -> None:
    space = space_of(tmp_path)
    assert len(space) == 25 == len({*space.names}) and space.names[-1] == "points"
    assert space.names[:2] == ("fl_rotor_1", "fl_elevator_1") and space.names[12] == "fl_rotor_2"


def test_it_goes_through_its_poses_and_comes_back_to_rest(tmp_path) -> None:
    space = space_of(tmp_path, KICK + "poses = 3\n")
    genes = space.feasible(drawn(space, 2))
    seconds = genes[:, -1] / 62.5  # from a pose to the next
    for gait, lasts in zip(genes, seconds, strict=True):
        told = space.targets(gait[None], lasts * np.array([0, 1, 1.5, 2, 3, 4, 9]))[0]
        first, second, third = gait[:-1].reshape(3, 12)
        wanted = [space.pose, first, (first + second) / 2, second, third, space.pose, space.pose]
        assert np.allclose(told, wanted)


def test_joints_follow_others_mirrored_or_together_and_the_rest_stay(tmp_path) -> None:
    space = space_of(tmp_path, KICK + PAIRS)
    assert space.names == ("fl_rotor_1", "fl_knee_1", "fl_rotor_2", "fl_knee_2", "points")
    names = [action.split("/")[0] for action in space.actions]
    told = dict(zip(names, space.passed(drawn(space, 1))[1][0].T, strict=True))
    assert np.array_equal(told["fr_rotor"][1:-1], -told["fl_rotor"][1:-1])
    assert np.array_equal(told["fr_knee"], told["fl_knee"]) and np.ptp(told["fl_knee"]) > 0.1
    assert np.ptp(told["rl_knee"]) == 0.0
    low, high = np.radians([-115.0, 115.0])  # of the rotor: -130 to 115, and mirrored
    assert np.allclose(space.bounds[0], [low, high])


@pytest.mark.parametrize(
    "motion", [KICK, KICK + PAIRS, KICK + "poses = 5\nranges = { points = [1.0, 4.0] }\n"]
)
def test_what_is_made_feasible_keeps_every_limit_at_every_time(motion: str, tmp_path) -> None:
    """By being slower; where it may not be slow enough, by poses nearer to rest."""
    space = space_of(tmp_path, motion)
    wild = drawn(space, 6)
    genes = space.feasible(wild)
    assert all(space.problems(g) == () for g in genes)
    told = space.targets(genes, FINE)
    assert (told >= space.low - 1e-9).all() and (told <= space.high + 1e-9).all()
    assert (np.abs(np.diff(told, axis=1)) / FINE[1] <= space.speed + 1e-6).all()
    assert len(space.feasible(genes[:0])) == len(space.targets(genes[:0], FINE)) == 0
    assert np.allclose(space.feasible(genes), genes)
    if "points" not in motion:
        assert np.array_equal(genes[:, :-1], wild[:, :-1]), "only slower"


KNEES = KICK + 'joints = ["fl_knee"]\ntogether = { fr_knee = "fl_knee" }\n'


@pytest.mark.parametrize("points", [(1.0, 4.0), (1.0, 12.0)])
def test_ranges_that_leave_out_the_pose_at_rest_keep_the_limits_of_rates(points: tuple, tmp_path) -> None:
    """The knees stand at 1.31 rad and turn by 0.19 rad a point: to 1.9 they take 3.1 points."""
    told = f"ranges = {{ fl_knee_1 = [1.9, 2.2], fl_knee_2 = [0.2, 2.2], points = [{points[0]}, {points[1]}] }}\n"
    space = space_of(tmp_path, KNEES + told)
    genes = space.feasible(drawn(space, 20))
    assert all(space.problems(g) == () for g in genes)
    assert np.allclose(space.feasible(genes), genes) and np.ptp(genes, axis=0)[:-1].min() > 0.01


def test_a_motion_of_which_not_even_the_slowest_keeps_the_limits_is_refused(tmp_path) -> None:
    told = "ranges = { fl_knee_1 = [2.1, 2.2], points = [1.0, 3.0] }\n"
    with pytest.raises(RobotError, match="no gait of robot 'dog' keeps its limits: .* would turn at"):
        space_of(tmp_path, KNEES + told)


def test_drives_without_a_limit_of_their_rate_state_none(tmp_path) -> None:
    folder = toy_dog.folder(tmp_path / "dog", KICK, TASK)
    table = (folder / "robot.toml").read_text(encoding="utf-8")
    (folder / "robot.toml").write_text(table.replace("speed_limit = 12.0\n", ""), encoding="utf-8")
    space = gait_space(load_robot(folder), "kick")
    stated = joints(space)
    assert {joint.speed for joint in stated} == {None}
    genes = space.feasible(drawn(space, 1))[0]
    assert space.problems(genes) == ()
    older = SimpleNamespace(robot="dog", joints=[replace(joint, speed=1e6) for joint in stated])
    require_own(space, space.as_dict(genes), older)
    with pytest.raises(UsageError, match="is not stated as the robot has it"):
        older.joints[0] = replace(stated[0], speed=20.0)
        require_own(space, space.as_dict(genes), older)


def test_what_cannot_be_run_is_told(tmp_path) -> None:
    space = space_of(tmp_path)
    fast = space.from_dict({**space.as_dict(space.bounds[:, 1]), "points": space.bounds[-1, 0]})
    assert any("would turn at" in problem for problem in space.problems(fast))
    far = space.from_dict({**space.as_dict(space.rest), "fl_knee_2": 3.0, "points": 30.0})
    assert [p.split(" ")[0] for p in space.problems(far)] == ["fl_knee_2", "fl_knee/target"]


def test_a_motion_is_made_in_a_simulator_as_a_gait_is(tmp_path) -> None:
    robot = load_robot(toy_dog.folder(tmp_path / "dog", KICK, TASK))
    trials = Trials(robot, task_of(robot), Simulators(robot.space.nominal[None]), rate=robot.rate, threads=1)
    assert isinstance(trials.space, Poses)
    about = trials.space.from_unit(trials.space.about_rest(100, stream(1, "rest")))
    assert np.abs(np.median(about[:, :-1], axis=0) - trials.space.rest[:-1]).max() < 0.3
    crouch = trials.space.as_dict(trials.space.rest) | {"points": 30.0}
    crouch |= {f"{leg}_knee_{p}": 1.6 for leg in ("fl", "fr", "rl", "rr") for p in (1, 2)}
    walk = trials.walk(trials.space.feasible(trials.space.from_dict(crouch)[None]))
    heights = walk.base[0, 0, :, 2]
    assert heights.min() < heights[0] - 0.01 and abs(heights[-1] - heights[0]) < 0.005


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        (KICK + 'joints = ["fl_wing"]\n', "no action drives joint 'fl_wing'"),
        (KICK + 'joints = ["fl_knee"]\nmirrored = { fr_knee = "fl_rotor" }\n', "is followed and not free"),
        (KICK + 'joints = ["fl_knee"]\nmirrored = { fl_knee = "fl_knee" }\n', "joint 'fl_knee' stands twice"),
        (KICK + 'kind = "locus"\n', r"motion 'kick' is of unknown kind 'locus'.*\['poses'\]"),
        (KICK + "ranges = { speed = [0.0, 1.0] }\n", "ranges names 'speed'"),
        (KICK + "ranges = { points = [-3.0, 9.0] }\n", r"points = \[-3, 9\].*above 0"),
        (KICK + "ranges = { points = [0.0, 9.0] }\n", r"points = \[0, 9\].*above 0"),
        (KICK.replace("kick", "jump"), "there is no motion 'kick'"),
        (KICK + KICK, "named twice"),
    ],
)
def test_a_motion_that_does_not_fit_is_refused(motion: str, says: str, tmp_path) -> None:
    with pytest.raises(RobotError, match=says):
        space_of(tmp_path, motion)
