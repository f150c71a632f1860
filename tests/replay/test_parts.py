"""Fit, select and test part the windows of a recording, by trajectory."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import UsageError
from dynreg.replay.parts import Parts, names, parts, seen, train_part
from dynreg.replay.windows import Windows
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

ROWS = 11  # of a window; windows in a row share one


def made(counts: list[int]) -> tuple[Recording, Windows]:
    """Episodes "e0", "e1", ... of so many windows each, with gains 100, 200, 100, ..."""
    number = np.repeat(np.arange(len(counts)), counts)
    start = np.concatenate([np.arange(n) for n in counts]) * (ROWS - 1)
    episodes = [
        Episode(f"e{i}", np.arange(rows) * 0.1, i + np.zeros((rows, 1)), {"kp": 100.0 * (1 + i % 2)})
        for i, rows in enumerate(n * (ROWS - 1) + 1 for n in counts)
    ]
    measured = np.zeros((len(number), ROWS, 1))
    run = Run(np.zeros((len(number), ROWS - 1, 1)))
    rows = np.stack([start, start + ROWS], axis=1)
    windows = Windows(run, measured, np.ones(1), np.ones(1), number, rows, 0.1)
    return Recording((Channel("x", "m"),), tuple(episodes)), windows


@given(
    st.lists(st.integers(1, 3), min_size=1, max_size=9),
    st.one_of(st.none(), st.floats(0, 0.9).map(str), st.sampled_from(["kp=100", "e0"])),
    st.integers(0, 5),
)
def test_every_window_is_in_one_part_and_no_trajectory_in_two(counts, hold_out, seed):
    recording, windows = made(counts)
    try:
        split = parts(recording, windows, hold_out, seed)
    except UsageError as error:
        assert "leaves nothing" in str(error)
        return
    masks = np.stack([split.fit, split.select, split.test]).astype(int)
    assert (masks.sum(axis=0) == 1).all() and split.fit.any()
    np.testing.assert_array_equal(split.chosen, np.flatnonzero(~split.test))
    if len(counts) >= 4:
        for number in range(len(counts)):
            assert (masks[:, windows.episode == number].max(axis=1).sum()) == 1


@pytest.mark.parametrize(
    "hold_out, test",
    [
        ("kp=200", {"e1", "e3", "e5"}),
        ("kp=200,100.0", None),
        ("e0", {"e0"}),
        ("e4, e1", {"e1", "e4"}),
        ("e[14]", {"e1", "e4"}),
        ("0", set()),
        ("0.5", 3),
        ("0.01", 1),
        (None, 1),
    ],
)
def test_what_can_be_held_out(hold_out, test):
    recording, windows = made([2] * 6)
    if test is None:
        with pytest.raises(UsageError, match="leaves nothing to choose by"):
            parts(recording, windows, hold_out)
        return
    split = parts(recording, windows, hold_out)
    held = {f"e{i}" for i in windows.episode[split.test]}
    assert len(held) == test if isinstance(test, int) else held == test


@pytest.mark.parametrize("hold_out", ["0.25", "e0"])
def test_of_an_episode_that_is_one_window_nothing_can_be_held_out_without_a_horizon(hold_out):
    recording, windows = made([1])
    assert not parts(recording, windows, None).test.any()
    with pytest.raises(UsageError, match=r"\[replay\] of robot.toml a horizon.*or record more episodes"):
        parts(recording, windows, hold_out)
    cut = made([4])
    assert parts(*cut, "0.25").test.sum() == 1
    with pytest.raises(UsageError, match="hold out less, or record more"):
        parts(*made([2] * 6), "kp=200,100.0")


@pytest.mark.parametrize("hold_out", ["kp=400", "kp=high", "e9", "mass=1", "1.0", "-0.2", "nan", "inf"])
def test_what_cannot_be_held_out_is_refused(hold_out):
    with pytest.raises(UsageError, match="hold-out"):
        parts(*made([2] * 6), hold_out)


def test_the_split_depends_on_the_seed_and_is_the_same_each_time():
    recording, windows = made([1] * 40)
    one, again, other = (parts(recording, windows, None, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.test, again.test)
    assert one.test.sum() == other.test.sum() == 8 and (one.test != other.test).any()


def test_few_episodes_are_parted_by_windows():
    recording, windows = made([10])
    split = parts(recording, windows, None)
    assert split.test.sum() == 2 and split.select.sum() == 2
    assert set(names(recording, windows, split.test)) == {f"e0[{w}]" for w in np.flatnonzero(split.test)}
    recording, windows = made([1])
    assert not parts(recording, windows, None).test.any(), "a single window cannot be parted"


@given(st.lists(st.integers(1, 4), min_size=1, max_size=6), st.data())
def test_what_is_seen_are_the_rows_of_the_chosen_windows(counts, data):
    recording, windows = made(counts)
    size = len(windows)
    chosen = np.array(sorted(data.draw(st.sets(st.integers(0, size - 1), min_size=1))))
    rows = {(int(windows.episode[w]), r) for w in chosen for r in range(*windows.rows[w])}
    visible = seen(recording, windows, chosen)
    found = {
        (int(v), round(t * 10)) for e in visible.episodes for v, t in zip(e.values[:, 0], e.time, strict=True)
    }
    assert found == rows
    # windows in a row stay together: no transition between them is lost
    steps = sum(len(e.time) - 1 for e in visible.episodes)
    assert steps == len(chosen) * (ROWS - 1)


def test_repeated_commands_are_parted_between_fit_and_select():
    recording, windows = made([1] * 12)
    commands = np.sin(np.arange(10)[None, :, None] * np.linspace(0.1, 2.0, 6)[:, None, None])
    run = Run(np.concatenate([commands, commands]))  # episodes 6 to 11 repeat episodes 0 to 5
    windows = dataclasses.replace(windows, run=run, measured=np.zeros((12, ROWS, 1)))
    for seed in range(5):
        split = parts(recording, windows, "0", seed, paired=True)
        assert not split.test.any()
        np.testing.assert_array_equal(split.fit[:6], split.select[6:])
        np.testing.assert_array_equal(split.fit, ~split.select)
    split = parts(recording, windows, "e0,e1,e2", paired=True)
    assert split.test.sum() == 3 and split.select.sum() == 4 and split.fit.sum() == 5, "the odd one is fitted"


def test_what_is_not_held_out_is_whole_episodes_and_the_other_windows_of_a_part_of_one():
    recording, windows = made([2, 1, 3])
    test = np.array([False, False, True, False, True, False])
    split = Parts(~test, np.zeros_like(test), test)
    found = train_part(load_robot("servo_pendulum"), recording, windows, split)
    assert [(e.name, len(e.time)) for e in found.episodes] == [
        ("e0", 21),
        ("e2[0:11]", 11),
        ("e2[20:31]", 11),
    ]
    nothing = replace(split, test=np.zeros_like(test))
    assert (
        train_part(load_robot("servo_pendulum"), recording, windows, nothing).episodes == recording.episodes
    )
