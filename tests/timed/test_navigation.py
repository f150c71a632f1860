"""The navigation task: what a plan means, where its path leads, what it is worth, and that evolution raises that."""

from dataclasses import replace

import numpy as np
import pytest

from dynreg.errors import UsageError
from dynreg.rng import stream
from dynreg.search.genetic import Rules
from dynreg.timed.commands import Commands, chained, in_a_row
from dynreg.timed.models import Kinematic, Unicycle
from dynreg.timed.navigation import (
    COMMANDS,
    CORNERS,
    KHEPERA_RANGE,
    ROBOT,
    SAMPLE,
    TICK,
    CommandRange,
    Course,
    Path,
    Plan,
    driven,
    evolve,
    fitness,
    path_along,
    short,
    visited,
)
from dynreg.timed.unicycle import KHEPERA

TRACK = 0.0884
SMALL = Rules(60, 12, mutation=0.15)
CENTRES, AREA = CORNERS.centres, np.ptp(CORNERS.area, axis=0)
MODEL = Kinematic(TRACK)


def plan(*commands: tuple[float, float, float]) -> Plan:
    """Commands (left, right, seconds); the others are left out."""
    table = np.zeros((1, COMMANDS, 3))
    table[0, : len(commands)] = commands
    return Plan(*np.moveaxis(table, -1, 0), np.arange(COMMANDS)[None] >= len(commands))


def path(*points: tuple[float, float], time: float = 10.0) -> Path:
    """All points in the first command; the robot ends at the last."""
    where = np.full((1, COMMANDS, 20, 3), np.nan)
    where[0, 0, : len(points), :2] = points
    return Path(where, np.array([[*points[-1], 0.0]]), np.array([time]))


def test_genes_are_commands_within_their_ranges() -> None:
    unit = np.zeros((2, 40))
    unit[1] = 1.0
    low, high = Plan.of(unit).left, Plan.of(unit).seconds
    assert (low[0] == -0.22).all() and (low[1] == 0.22).all()
    assert high[0] == pytest.approx(0.1) and high[1] == pytest.approx(2.0)
    assert not Plan.of(unit).null[0].any() and Plan.of(unit).null[1].all()


def test_a_path_has_a_point_every_tenth_of_a_second_and_one_at_each_end() -> None:
    found = driven(plan((0.2, 0.2, 0.25), (0.1, 0.1, 0.3)), MODEL)
    first, second = found.points[0, 0], found.points[0, 1]
    assert first[:3, 0] == pytest.approx([0.02, 0.04, 0.05]) and np.isnan(first[3:]).all()
    assert second[:3, 0] == pytest.approx([0.06, 0.07, 0.08]) and np.isnan(second[3:]).all()
    assert found.end[0] == pytest.approx([0.08, 0.0, 0.0]) and found.time[0] == pytest.approx(0.55)
    assert np.isnan(found.points[0, 2:]).all()


def test_left_out_commands_change_nothing_and_lags_go_on_over_them() -> None:
    model = Unicycle(KHEPERA, TRACK)
    gap = plan((0.2, 0.1, 0.5), (0.0, 0.0, 1.0), (0.1, 0.2, 0.7))
    gap.null[0, 1] = True
    without = driven(plan((0.2, 0.1, 0.5), (0.1, 0.2, 0.7)), model)
    found = driven(gap, model)
    assert np.array_equal(found.end, without.end) and found.time == without.time
    stop = driven(plan((0.2, 0.1, 0.5), (0.0, 0.0, 1.0), (0.1, 0.2, 0.7)), model)
    assert np.abs(stop.end - found.end).max() > 0.001


def test_the_middle_of_commands_is_where_shorter_ones_end() -> None:
    model = Unicycle(KHEPERA, TRACK)
    whole = driven(plan((0.2, -0.1, 0.6), (0.1, 0.2, 0.73)), model)
    part = driven(plan((0.2, -0.1, 0.6), (0.1, 0.2, 0.5)), model)
    assert whole.points[0, 1, 4] == pytest.approx(part.end[0], abs=1e-9)


def test_fitness_is_the_papers() -> None:
    """Blocks, seconds, centimetres from where the robot should be, centimetres outside."""
    middle = path((0.3, 0.0), (0.0, 0.0))
    value, blocks = fitness(middle)
    nearest = 100 * np.linalg.norm(CENTRES[0])
    assert blocks[0] == 0 and value[0] == pytest.approx(-2.5 * 10.0 - 5.0 * nearest)
    one, blocks = fitness(path((0.45, 0.2), (0.45, -0.1)))
    assert blocks[0] == 2  # at 0.1 m beside its middle it is in the second block
    home = path(*map(tuple, CENTRES), (0.03, 0.04), time=20.0)
    value, blocks = fitness(home)
    assert blocks[0] == 4 and value[0] == pytest.approx(4000.0 - 2.5 * 20.0 - 5.0 * 5.0)
    far = path(*map(tuple, CENTRES), (AREA[0] / 2 + 0.03, AREA[1] / 2 + 0.04), (0.0, 0.0), time=20.0)
    assert fitness(far)[0][0] == pytest.approx(4000.0 - 2.5 * 20.0 - 2.5 * 5.0)


def test_a_plan_is_sought_by_the_blocks_that_the_whole_robot_gets_into() -> None:
    edge = path((0.31, 0.2), (0.0, 0.0))
    assert fitness(edge)[1][0] == 1 and fitness(edge, within=ROBOT)[1][0] == 0
    assert fitness(path((0.37, 0.2), (0.0, 0.0)), within=ROBOT)[1][0] == 1
    with pytest.raises(UsageError, match="half a side"):
        evolve(MODEL, within=0.15)
    found = evolve(MODEL, generations=30, rules=SMALL, within=0.0)
    assert found.places > evolve(MODEL, generations=30, rules=SMALL, within=0.149).places


def test_evolution_finds_blocks_and_the_same_again() -> None:
    given = {"generations": 120, "rules": SMALL}
    found = evolve(MODEL, **given)
    drawn = fitness(driven(Plan.of(stream(1, "drawn").uniform(size=(60, 40))), MODEL), within=ROBOT)[0]
    assert found.fitness > drawn.max() + 500 and found.places >= 2
    value, blocks = fitness(driven(Plan.of(found.genes[None]), MODEL), within=ROBOT)
    assert value[0] == found.fitness and blocks[0] == found.places
    assert np.array_equal(evolve(MODEL, **given).genes, found.genes)


def test_a_model_that_diverges_on_the_way_is_worth_nothing() -> None:
    wild = Unicycle(
        np.array([1e-3, 0.1, 0.0, 1.0, 0.0, 1.0]), TRACK
    )  # steps of 10 ms are far too long for 1 ms
    plans = plan((0.1, 0.1, 2.0))
    assert np.isfinite(driven(plans, wild).points[0, 0, 0]).all()
    assert np.isnan(fitness(driven(plans, wild))[0]).all()


def test_the_papers_course_is_the_smallest_area_around_its_corners() -> None:
    around = Course.around([tuple(c) for c in CENTRES], CORNERS.side)
    assert np.array_equal(around.centres, CENTRES) and around.back
    assert around.area == pytest.approx(np.array([[-0.6, -0.35], [0.6, 0.35]])) == CORNERS.area
    assert AREA == pytest.approx([1.2, 0.7]) and CORNERS.back


def test_the_start_lies_in_the_usual_area() -> None:
    assert Course.around([(1.0, 0.5)], 0.2).area == pytest.approx(np.array([[0.0, 0.0], [1.1, 0.6]]))
    given = np.array([[-1.0, -1.0], [2.0, 2.0]])
    assert Course.around([(1.0, 0.5)], 0.2, given).area is given


def test_a_course_without_a_way_back_ends_in_a_place() -> None:
    course = Course.around([(1.0, 0.0), (1.0, 1.0)], 0.2, back=False)
    way = path((1.0, 0.05), (1.0, 0.5), (1.0, 0.97))
    assert visited(way, course).tolist() == [[True, True]] and short(way, course)[0] == pytest.approx(0.03)
    value, count = fitness(way, course)
    assert count[0] == 2 and value[0] == pytest.approx(2000.0 - 2.5 * 10.0 - 5.0 * 3.0)
    home = Course.around([(1.0, 0.0), (1.0, 1.0)], 0.2)
    assert fitness(way, home)[0][0] == pytest.approx(2000.0 - 2.5 * 10.0 - 500.0 * np.hypot(1.0, 0.97))


def test_points_below_and_above_an_area_count_as_outside() -> None:
    course = Course.around([(1.0, 0.0)], 0.2, np.array([[-0.1, -0.2], [1.1, 0.2]]))
    inside, below, above = (
        path((1.0, 0.0), point, (0.0, 0.0)) for point in ((0.5, 0.0), (-0.2, -0.2), (1.1, 0.5))
    )
    values = [fitness(way, course)[0][0] for way in (inside, below, above)]
    assert values[0] - values[1] == pytest.approx(2.5 * 10.0) and values[0] - values[2] == pytest.approx(
        2.5 * 30.0
    )


def test_commands_are_told_in_the_robots_own_numbers() -> None:
    """Speed and yaw rate become speeds of the wheels, and times are multiples of the robot's period."""
    wheels = np.array([[1.0, -0.1], [1.0, 0.1]])
    ranges = CommandRange(np.array([0.1, -1.0]), np.array([0.3, 2.0]), (0.1, 0.5), 0.04, wheels)
    unit = np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]])
    assert ranges.told(unit)[0] == pytest.approx(np.array([[0.1, -1.0], [0.3, 2.0]]))
    made = Plan.of(unit, ranges)
    assert made.left[0] == pytest.approx([0.2, 0.1]) and made.right[0] == pytest.approx([0.0, 0.5])
    assert made.seconds[0] == pytest.approx([0.08, 0.48]) and made.null[0].tolist() == [False, True]
    brief = CommandRange(np.zeros(2), np.ones(2), (0.001, 0.002), 0.04)
    assert Plan.of(unit, brief).seconds[0] == pytest.approx([0.04, 0.04])
    assert made.ticks[0].tolist() == [2, 0] and made.speeds(0) == pytest.approx(np.tile([0.2, 0.0], (2, 1)))
    free = Plan.of(unit, CommandRange(np.zeros(2), np.ones(2), (0.1, 0.2)))
    with pytest.raises(UsageError, match="range has a tick"):
        _ = free.ticks


def test_a_path_is_cut_by_the_tick_of_its_plan() -> None:
    """Ticks of 50 ms: a point every other one, and one at the end of each command."""
    brief = CommandRange(np.full(2, 0.2), np.full(2, 0.2), (0.25, 0.25), 0.05)
    plans = Plan.of(np.array([[0.0, 0.0, 0.0, 0.0] * 2]), brief)
    poses = np.zeros((1, 11, 3))
    poses[0, :, 0] = 0.01 * np.arange(11)
    found = path_along(plans, poses)
    assert found.points[0, :, :, 0] == pytest.approx(np.array([[0.02, 0.04, 0.05], [0.07, 0.09, 0.1]]))
    assert found.time[0] == pytest.approx(0.5) and found.end[0, 0] == pytest.approx(0.1)


def test_a_range_is_what_most_commands_of_a_recording_said_and_the_robot_takes() -> None:
    many, wheels = np.arange(101), np.array([[1.0, -0.1], [1.0, 0.1]])
    speed, turn = 0.01 * many - 0.5, 0.02 * many - 1.0
    sides = np.stack([speed, turn], axis=1) @ wheels.T
    told = Commands(*sides.T, 0.01 * (1 + many), *np.zeros((2, 101)))
    found = CommandRange.used(told, wheels, 0.02, np.array([[-0.3, -2.0], [0.5, 2.0]]))
    assert found.low == pytest.approx([-0.3, -0.9]) and found.high == pytest.approx([0.45, 0.9])
    assert found.seconds == pytest.approx((0.06, 0.96)) and found.tick == 0.02


def test_times_that_are_asked_for_are_rounded_inside() -> None:
    ranges, unit = CommandRange(np.zeros(2), np.ones(2), (0.1, 2.0), 0.02), np.zeros((1, 8))
    unit[0, 4:] = 1.0
    for asked, told in (
        ((0.05, 0.09), (0.06, 0.08)),
        ((0.5, 2.0), (0.5, 2.0)),
        ((0.001, 0.039), (0.02, 0.02)),
    ):
        assert Plan.of(unit, ranges.lasting(*asked)).seconds[0] == pytest.approx(told)
    for asked in ((0.05, 0.05), (0.001, 0.005)):
        words = f"seconds {asked[0]:g},{asked[1]:g}; expected at least one multiple of 0.02 s between them; ask for"
        with pytest.raises(UsageError, match=words):
            ranges.lasting(*asked)
    assert CommandRange(np.zeros(2), np.ones(2), (0.1, 2.0)).lasting(0.05, 0.05).seconds == (0.05, 0.05)


def test_no_time_is_rounded_above_the_longest_of_a_recording() -> None:
    still = np.zeros((2, 4)), np.zeros((2, 4))
    for lasts, told in ((0.15, 0.12), (0.12, 0.12), (0.01, 0.04)):
        log = Commands(*still[0], np.full(4, lasts), *still[1])
        ranges = CommandRange.used(log, np.eye(2), 0.04, np.array([[-1.0, -1.0], [1.0, 1.0]]))
        assert Plan.of(np.ones((1, 4)), ranges).seconds[0, 0] == pytest.approx(told)
        assert Plan.of(np.zeros((1, 4)), ranges).seconds[0, 0] == pytest.approx(told)


def test_the_least_way_and_the_highest_speed_bound_what_can_be_reached() -> None:
    assert Course.around([(10.0, 0.0), (1.0, 0.0)], 0.2).least_way == pytest.approx(19.8)
    assert Course.around([(3.1, 4.1)], 0.2, back=False).least_way == pytest.approx(5.0)
    assert Course.around([(0.0, 0.0)], 0.2).least_way == 0.0
    wheels = np.array([[1.0, -0.1], [1.0, 0.1]])
    assert CommandRange(np.array([-0.4, -2.0]), np.array([0.3, 2.0]), (0.1, 1.0), 0.0, wheels).fastest == 0.4


def test_a_plan_of_some_commands_reaches_one_place() -> None:
    course = Course.around([(0.3, 0.1)], 0.1, back=False)
    given = {"generations": 40, "rules": SMALL, "within": 0.025}
    found = evolve(MODEL, course, replace(KHEPERA_RANGE, commands=3), **given)
    assert found.genes.shape == (12,) and found.places == 1
    assert short(driven(Plan.of(found.genes[None]), MODEL), course)[0] < 0.025


def test_commands_last_whole_ticks_of_the_robots_clock() -> None:
    found = Plan.of(stream(2, "genes").uniform(size=(30, 40)))
    assert found.seconds == pytest.approx(TICK * np.round(found.seconds / TICK), abs=1e-12)
    assert len(np.unique(np.round(found.seconds / TICK))) > 50
    assert (found.ticks[found.null] == 0).all()
    assert TICK * found.ticks[~found.null] == pytest.approx(found.seconds[~found.null])
    rows = found.speeds(3)
    assert rows.shape == (found.ticks[3].sum(), 2)
    first = int(np.flatnonzero(~found.null[3])[0])
    assert np.array_equal(rows[0], [found.left[3, first], found.right[3, first]])


class Ticking:
    """The closed form, tick by tick: its state goes on from command to command."""

    def drive(self, plans: Plan) -> Path:
        poses = np.zeros((len(plans.left), plans.ticks.sum(axis=1).max() + 1, 3))
        for number, way in enumerate(poses):
            told = plans.speeds(number)
            moved = MODEL.predict(in_a_row(*told.T, np.full(len(told), TICK)))
            way[: len(told) + 1] = chained(moved)
        return path_along(plans, poses)


def test_what_drives_whole_plans_is_asked_to_and_cut_the_same() -> None:
    plans = Plan.of(stream(3, "genes").uniform(size=(12, 40)))
    ticking, found = driven(plans, Ticking()), driven(plans, MODEL)
    assert ticking.end == pytest.approx(found.end, abs=1e-9) and ticking.time == pytest.approx(found.time)
    width = min(ticking.points.shape[2], found.points.shape[2])
    assert np.allclose(ticking.points[:, :, :width], found.points[:, :, :width], atol=1e-9, equal_nan=True)
    assert not np.isfinite(found.points[:, :, width:]).any()
    longest = np.isfinite(ticking.points[..., 0]).sum(axis=2).max()
    assert longest == round(np.ceil(plans.seconds[~plans.null].max() / SAMPLE - 1e-9))
    assert fitness(ticking)[0] == pytest.approx(fitness(found)[0], abs=1e-6)


def test_a_plan_without_commands_stays_where_it_is() -> None:
    found = driven(Plan.of(np.ones((1, 40))), Ticking())
    assert np.array_equal(found.end, np.zeros((1, 3))) and found.time[0] == 0.0 and fitness(found)[1][0] == 0


def test_an_evolution_tells_when_its_fitness_rose() -> None:
    given = {"rules": Rules(40, 8, mutation=0.15), "seed": 4}
    found = evolve(MODEL, generations=30, **given)
    tried, values = zip(*found.history, strict=True)
    assert list(tried) == sorted(tried) and list(values) == sorted(values) and values[-1] == found.fitness
    part = evolve(MODEL, generations=10, **given)
    assert part.fitness == [v for n, v in found.history if n <= 400][-1]
