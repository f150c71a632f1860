"""The goal task: what is seen, what a step does, walls, and steps to the target."""

import numpy as np
import pytest

from dynreg.rng import stream
from dynreg.timed import goal
from dynreg.timed.commands import Commands
from dynreg.timed.goal import FIELD, LEVELS, ROBOT, STEPS, TARGET, Trials, cells, seen, tried
from dynreg.timed.kinematic import kinematic
from dynreg.timed.pulsed import GENES, INPUTS, Controllers

TRACK = 0.09


def mover(cell: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Half a second of the closed form."""
    left, right = (side[cell] for side in cells())
    return kinematic(Commands(left, right, np.full(len(cell), 0.5), left, right), TRACK)


class Driver(Controllers):
    """Turns towards the target as it is seen, in place of neurons."""

    @classmethod
    def many(cls, count: int) -> "Driver":
        return cls(
            *(
                getattr(Controllers.of(np.zeros((count, GENES))), n)
                for n in ("inputs", "neurons", "thresholds")
            )
        )

    def take(self, which: np.ndarray) -> "Driver":
        return Driver.many(len(which))

    def commands(self, seen: np.ndarray) -> np.ndarray:
        sector = seen[:, :64].reshape(-1, 16, 4).any(axis=2).argmax(axis=1)
        left = np.where((sector > 0) & (sector < 8), 10, 19)
        right = np.where(sector >= 8, 10, 19)
        return np.stack([left, right], axis=1)


def test_the_target_is_seen_where_it_is() -> None:
    pose = np.array([[*(TARGET - [0.9, 0.0]), 0.0], [*(TARGET - [0.9, 0.0]), 0.5 * np.pi], [0.4, 0.4, 0.0]])
    image = seen(pose)[:, :64].reshape(3, 16, 4)
    assert np.argwhere(image[0]).tolist() == [[0, 1], [0, 2]]  # 0.65 m away, and the ring behind
    assert np.argwhere(image[1]).tolist() == [[12, 1], [12, 2]]  # to the right
    assert np.argwhere(image[2]).tolist() == [[2, 3]]  # far, about 45 degrees to the left
    assert seen(pose).shape == (3, INPUTS)


def test_walls_are_seen_all_around() -> None:
    image = seen(np.array([[0.2, 1.1, 0.0], [0.2, 1.1, np.pi]]))[:, 64:].reshape(2, 16, 4)
    assert image.any(axis=2).all()
    assert image[0, 8].tolist() == image[1, 0].tolist() == [True, True, False, False]  # 0.2 m
    assert image[0, 0].tolist() == [False, False, False, True]  # 2.2 m
    assert image[0, 4].tolist() == [False, False, True, True]  # 1.1 m


def test_who_drives_to_the_target_gets_there_and_the_trial_ends() -> None:
    found = tried(Driver.many(2), mover)
    assert found.reached.all() and (found.steps == found.steps[0]).all()
    for way, steps in zip(found.ways[0], found.steps[0], strict=True):
        away = np.linalg.norm(way[:, :2] - TARGET, axis=1)
        assert away[steps] <= 0.25 < away[steps - 1] and np.array_equal(
            way[steps:], np.tile(way[steps], (41 - steps, 1))
        )
    assert found.fitness[0] == pytest.approx(np.mean(1.0 - found.steps[0] / 40))


def test_walls_hold_and_who_does_not_arrive_has_used_all_steps() -> None:
    straight = tried(
        Controllers.of(np.zeros((1, GENES))), lambda cell, _: np.tile([0.0, 0.2, 0.0], (len(cell), 1))
    )
    assert (straight.steps == STEPS).all() and straight.fitness[0] == 0.0 and not straight.reached.any()
    up, right = straight.ways[0, 0, -1], straight.ways[0, 2, -1]
    assert up[:2] == pytest.approx([0.4, FIELD[1] - ROBOT]) and right[:2] == pytest.approx(
        [FIELD[0] - ROBOT, 0.4]
    )


def test_fitness_is_the_mean_over_the_trials() -> None:
    assert Trials(np.zeros(0), np.array([[10, 20, 30, 40]]), np.zeros(0)).fitness == pytest.approx([0.375])


def test_every_cell_is_a_pair_of_speeds_and_controllers_move_the_robot() -> None:
    left, right = cells()
    assert len({*zip(left, right, strict=True)}) == 400 and left[20] == LEVELS[1] and right[20] == LEVELS[0]
    some = Controllers.of(stream(4, "genes").uniform(size=(6, GENES)))
    ways = tried(some, mover).ways
    assert np.ptp(ways[:, 0, :, :2], axis=1).max() > 0.2
    both = tried(some.take(np.array([2])), mover).ways
    assert np.allclose(both[0], ways[2])
    assert goal.DRAWS == 2


def test_a_mover_is_told_the_command_before() -> None:
    """Standstill at first; then what the step before told, and in the second half of a step the same command."""
    asked = []

    def moved(cell: np.ndarray, before: np.ndarray) -> np.ndarray:
        asked.append((cell.copy(), before.copy()))
        return mover(cell, before)

    tried(Driver.many(1), moved)
    cells_told, before = zip(*asked[: 2 * 8], strict=True)
    assert (before[0] == -1).all()
    for half in range(1, 16):
        assert np.array_equal(before[half], cells_told[half - 1])
    assert len({int(c[0]) for c in cells_told}) > 1


def test_walls_are_as_far_as_a_line_that_is_followed_to_them() -> None:
    rng = stream(6, "poses")
    where, heading = rng.uniform([0.1, 0.1], FIELD - 0.1, (20, 2)), rng.uniform(-np.pi, np.pi, (20, 16))
    found = goal._to_wall(where[:, None], heading)
    for at, row, far in zip(where, heading, found, strict=True):
        for angle, distance in zip(row, far, strict=True):
            along = at + np.arange(0.0, 4.0, 1e-3)[:, None] * [np.cos(angle), np.sin(angle)]
            outside = ((along < 0) | (along > FIELD)).any(axis=1)
            assert distance == pytest.approx(1e-3 * int(outside.argmax()), abs=2e-3)


def test_each_sector_sees_the_wall_that_lies_its_way() -> None:
    """Sixteen equal angles from straight ahead, each in the ring of its distance and in the next."""
    pose = stream(8, "poses").uniform([0.1, 0.1, -np.pi], [*(FIELD - 0.1), np.pi], (30, 3))
    image = seen(pose)[:, 64:].reshape(30, 16, 4)
    for sector in range(16):
        far = goal._to_wall(pose[:, None, :2], pose[:, 2:] + sector * np.pi / 8)[:, 0]
        ring = np.searchsorted(goal.RINGS, far, side="right")
        wanted = np.zeros((30, 4), dtype=bool)
        wanted[np.arange(30), ring] = wanted[np.arange(30), np.minimum(ring + 1, 3)] = True
        assert np.array_equal(image[:, sector], wanted)
