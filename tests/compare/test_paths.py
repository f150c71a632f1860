"""Commands in a row: which follow each other, and where predictions of them end."""

from dataclasses import replace

import numpy as np
import pytest
from driven_robot import commands, config, logged

from dynreg.compare.contenders import Made
from dynreg.compare.paths import COMMANDS, driven, ends, runs
from dynreg.data.recording import Episode, Recording
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot
from dynreg.timed.kinematic import kinematic
from dynreg.timed.models import Kinematic
from dynreg.timed.told import Told, told
from dynreg.timed.wheels import POSE


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("diffdrive")


@pytest.fixture(scope="module")
def log(robot: Robot) -> Recording:
    """Two episodes on one clock: the second begins when the first ends."""
    made = logged(robot, config(robot), [commands(robot, 25, 1), commands(robot, 31, 2)])
    first, second = made.episodes
    return Recording(made.channels, (first, replace(second, time=second.time + first.time[-1])))


def test_runs_do_not_reach_over_gaps_nor_into_another_episode(robot: Robot, log: Recording) -> None:
    found = told(robot, log)
    assert runs(found, 0).tolist() == [list(range(a, a + COMMANDS)) for a in (0, 10, 25, 35, 45)]
    assert runs(found, 17).tolist() == [list(range(a, a + COMMANDS)) for a in (25, 35, 45)]
    first = log.episodes[0]
    values = first.values.copy()
    begin = np.searchsorted(first.time, found.begin[4] - 1e-9)
    values[begin, log.names.index("base/yaw")] = np.nan  # no pose: commands 3 and 4 are left out
    holed = told(robot, Recording(log.channels, (Episode("run", first.time, values),)))
    assert runs(holed, 0).tolist() == [list(range(3, 13)), list(range(13, 23))]
    assert runs(holed, 20).shape == (0, COMMANDS)


class Off:
    """Displacements that are right but for the last command of each run, which goes too far ahead."""

    def __init__(self, told: Told, metres: float):
        self.told, self.metres = told, metres

    def moved(self, which: np.ndarray, share: float = 1.0) -> np.ndarray:
        out = self.told.moved[which].copy()
        out[:, 1] += np.where(which % COMMANDS == COMMANDS - 1, self.metres, 0.0)
        return out


def test_the_end_of_a_path_is_off_by_what_its_last_command_is(robot: Robot, log: Recording) -> None:
    found = told(robot, Recording(log.channels, log.episodes[:1]))
    ten = runs(found, 0)
    paths = ends(found, {"right": Off(found, 0.0), "far": Off(found, 0.03)}, ten)
    assert paths.runs == 2 and paths.models["right"].max == pytest.approx(0.0, abs=1e-9)
    far = paths.models["far"]
    assert (far.min, far.mean, far.max) == pytest.approx((3.0, 3.0, 3.0)) and far.unit == "cm"
    assert ends(found, {"right": Off(found, 0.0)}, ten[:0]) is None


def test_places_are_not_made_up_over_gaps(robot: Robot, log: Recording) -> None:
    """A camera that is blind for all of a command but its ends, and one half as quick as the log."""
    first = log.episodes[0]
    found = told(robot, Recording(log.channels, (first,)))
    x = log.names.index("base/x")
    rows = np.searchsorted(first.time, [found.begin[3] - 1e-9, found.end[5] - 1e-9])
    values = first.values.copy()
    values[rows[0] + 1 : rows[1], x] = np.nan  # commands 3 to 5 but for their ends
    holed = Recording(log.channels, (Episode("run", first.time, values),))
    kinematic = {"kinematic": Made(Kinematic(found.track), found)}
    (path, _) = driven(found, holed, POSE, kinematic, runs(found, 0))
    unknown = [i for i, place in enumerate(path.measured.x) if place is None]
    assert unknown == list(range(13, 24)) and None not in path.measured.y
    values = first.values.copy()
    keep = np.zeros(len(values), dtype=bool)
    keep[::2] = True
    keep[np.searchsorted(first.time, [*found.begin - 1e-9, found.end[-1] - 1e-9])] = True
    values[~keep, x] = np.nan
    halved = Recording(log.channels, (Episode("run", first.time, values),))
    (path, _) = driven(found, halved, POSE, kinematic, runs(found, 0))
    assert None not in path.measured.x


def test_a_drawn_path_lies_on_the_measured_one_where_the_model_is_right(robot: Robot) -> None:
    """The closed form on wheels that turn as they are told; parts of a command are arcs as well."""
    rng = stream(1, "arcs")
    speeds, steps = rng.uniform(-0.2, 0.2, (COMMANDS, 2)), rng.integers(10, 60, COMMANDS)
    told_speeds = np.repeat(speeds, steps, axis=0)
    base = robot.file.base
    row = told(robot, logged(robot, config(robot), [told_speeds / base.wheel_radius]))
    pose = np.zeros((len(told_speeds) + 1, 3))
    for i, (left, right) in enumerate(told_speeds):
        turn, ahead = (right - left) / base.track * 0.02, 0.5 * (left + right) * 0.02
        chord = ahead * np.sinc(turn / (2 * np.pi))
        heading = pose[i, 2] + 0.5 * turn
        pose[i + 1] = pose[i] + [chord * np.cos(heading), chord * np.sin(heading), turn]
    log = logged(robot, config(robot), [told_speeds / base.wheel_radius])
    values = log.episodes[0].values.copy()
    values[:, log.columns(POSE)] = pose
    log = Recording(log.channels, (Episode("run", log.episodes[0].time, values),))
    found = told(robot, log)
    assert np.allclose(found.moved, kinematic(row.commands, base.track))
    (path,) = driven(found, log, POSE, {"kinematic": Made(Kinematic(base.track), found)}, runs(found, 0))
    way = path.models["kinematic"]
    assert len(way.x) == len(path.measured.x) == 1 + 4 * COMMANDS
    assert way.x == pytest.approx(path.measured.x, abs=2e-4) and way.y == pytest.approx(
        path.measured.y, abs=2e-4
    )
    assert path.seconds == pytest.approx(0.02 * len(told_speeds))
