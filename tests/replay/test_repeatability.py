"""Planted run-to-run spread comes back; white noise is white and AR(1) has the correlation time of its theory."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.verdict import WHITE
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.replay.cut import windows
from dynreg.replay.repeatability import ALIKE, repeatability, repeated, repeated_windows, whiteness
from dynreg.sim.robot import Robot, load_robot

NAMES = (("arm/position", "rad"), ("arm/velocity", "rad/s"), ("arm/target", "rad"), ("arm/enabled", "1"))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("servo_pendulum")


def commands(seed: int, rows: int = 300) -> np.ndarray:
    """(rows,) random levels, each held for a while."""
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, rows // 20 + 1), 20)[:rows]


def run(name: str, target: np.ndarray, seed: int, *, spread=(0.01, 0.1), kp=400.0, offset=0.0, enabled=1.0):
    """An episode that follows its commands with a lag, and noise of its own."""
    rng = np.random.default_rng(seed)
    q = np.convolve(target, np.exp(-np.arange(60) / 10) / 10, mode="full")[: len(target)]
    values = np.stack([q + offset, np.gradient(q, 0.01), target, np.full(len(q), enabled)], axis=1)
    values[:, :2] += np.array(spread) * rng.standard_normal((len(q), 2))
    return Episode(name, np.arange(len(q)) * 0.01, values, {"kp": kp})


def recording(*episodes: Episode) -> Recording:
    return Recording(tuple(Channel(*n) for n in NAMES), episodes)


def by_channel(robot: Robot, *episodes: Episode):
    return {r.channel: r for r in repeatability(robot, recording(*episodes))}


# ---- repeats ----


def test_the_planted_spread_is_recovered(robot):
    episodes = [run(f"run{i}", commands(i % 3), i) for i in range(9)]
    found = by_channel(robot, *episodes)
    assert found["arm/position"].spread == pytest.approx(0.01, rel=0.05)
    assert found["arm/velocity"].spread == pytest.approx(0.1, rel=0.05)
    assert found["arm/position"].pairs == 9 and found["arm/position"].samples == 9 * 300


def test_without_repeats_the_stated_noise_is_the_floor(robot):
    found = by_channel(robot, *(run(f"run{i}", commands(i), i) for i in range(5)))
    assert all(r.spread is None and r.pairs == 0 for r in found.values())
    assert found["arm/position"].stated == pytest.approx(np.sqrt(0.0005**2 + 0.001534**2 / 12))
    assert found["arm/velocity"].stated == pytest.approx(np.sqrt(0.02**2 + 0.024**2 / 12))


@pytest.mark.parametrize("shift", [1, 7, 40])
def test_runs_that_began_at_different_times_are_aligned(robot, shift):
    target = commands(0, 400)
    early = run("early", target, 0)
    late = run("late", target, 1)
    late = Episode("late", late.time[shift:], late.values[shift:], late.settings)
    found = by_channel(robot, early, late)
    assert found["arm/position"].samples == 400 - shift
    assert found["arm/position"].spread == pytest.approx(0.01, rel=0.15)


def test_a_constant_offset_between_two_runs_is_not_counted(robot):
    target = commands(0)
    found = by_channel(robot, run("a", target, 0), run("b", target, 1, offset=0.03))
    assert found["arm/position"].spread == pytest.approx(0.01, rel=0.15)


DIFFERENT = {
    "settings": {"kp": 800.0},
    "start": {"offset": 0.5},
    "enable": {"enabled": 0.0},
}


@pytest.mark.parametrize("change", DIFFERENT.values(), ids=DIFFERENT)
def test_runs_that_differ_in_what_is_known_do_not_repeat(robot, change):
    target = commands(0)
    others = [run("a", target, 0), run("b", target, 1, **change)]
    # motion and flags of other runs, so that the spread of every column is known
    others += [run("c", commands(1), 2, enabled=0.0), run("d", commands(2), 3)]
    assert not repeated(robot, recording(*others))


@pytest.mark.parametrize(("off", "pairs"), [(0.9 * ALIKE, 1), (1.1 * ALIKE, 0)])
def test_commands_need_to_agree_only_to_a_hundredth_of_their_spread(robot, off, pairs):
    target = commands(0)
    pair = recording(run("a", target, 0), run("b", target + off * target.std(), 1))
    assert len(repeated(robot, pair)) == pairs


def test_gaps_are_left_out_and_a_channel_that_was_never_measured_has_the_stated_floor(robot):
    target = commands(0)
    episodes = []
    for i in range(2):
        e = run(f"run{i}", target, i)
        values = e.values.copy()
        values[50 * i : 50 * i + 60, 0] = np.nan
        values[:, 1] = np.nan
        episodes.append(Episode(e.name, e.time, values, e.settings))
    found = by_channel(robot, *episodes)
    assert found["arm/position"].samples == 300 - 110
    assert found["arm/position"].spread == pytest.approx(0.01, rel=0.15)
    assert found["arm/velocity"].spread is None


def test_a_log_without_commands_or_with_single_rows_has_no_repeats(robot):
    bare = Recording((Channel("arm/position", "rad"),), (Episode("a", np.arange(2.0), np.zeros((2, 1))),))
    assert all(r.spread is None for r in repeatability(robot, bare))
    short = [Episode(f"e{i}", np.zeros(1), np.zeros((1, 4))) for i in range(2)]
    assert all(r.spread is None for r in repeatability(robot, recording(*short)))


# ---- whiteness ----


def ar(phi: float, shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """AR(1) series along the last axis, stationary from the start."""
    x = np.random.default_rng(seed).standard_normal(shape)
    x[..., 0] /= np.sqrt(1 - phi**2)
    for t in range(1, shape[-1]):
        x[..., t] += phi * x[..., t - 1]
    return x


def test_white_noise_is_white_as_often_as_the_test_says():
    p = np.array([whiteness(ar(0.0, (150,), seed)) for seed in range(300)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.03)
    assert np.mean(p) == pytest.approx(0.5, abs=0.06)


def test_many_windows_are_tested_as_one_series():
    p = np.array([whiteness(ar(0.0, (10, 40), seed)) for seed in range(300)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.03)
    assert whiteness(ar(0.3, (10, 40))) < WHITE


@pytest.mark.parametrize("phi", [0.3, -0.3, 0.9])
def test_correlated_noise_is_not_white(phi):
    assert whiteness(ar(phi, (500,))) < 1e-4


def test_ljung_box_is_the_published_formula():
    x = ar(0.2, (100,), 3)
    d = x - x.mean()
    r = np.array([d[k:] @ d[:-k] / (d @ d) for k in range(1, 21)])
    statistic = 100 * 102 * np.sum(r**2 / (100 - np.arange(1, 21)))
    assert whiteness(x) == pytest.approx(chi2.sf(statistic, 20))


def test_gaps_do_not_make_a_series_correlated():
    x = ar(0.0, (20, 100), 4)
    x[:, ::3] = np.nan
    x[3] = np.nan
    assert whiteness(x) > WHITE


@pytest.mark.parametrize(
    "series", [np.zeros(50), np.full(50, np.nan), np.arange(4.0), np.zeros(0), np.full(30, 0.1)]
)
def test_a_series_that_is_too_short_or_constant_cannot_be_told(series):
    assert whiteness(series) is None


def test_windows_that_repeat_are_found_and_no_others():
    robot = load_robot("servo_pendulum")
    plan = protocol(robot, seed=3, seconds=20.0)
    recording = log_of(robot, hide(robot, (), None, 3), plan)
    cut = windows(robot, recording)
    names = [recording.episodes[e].name for e in cut.episode]
    found = [(names[a], names[b]) for a, b in repeated_windows(robot, cut)]
    fits = sorted(name for name in plan.names if name.startswith("fit"))
    assert sorted(found) == [(name, name.replace("fit", "select")) for name in fits]


def test_windows_of_one_run_or_of_other_settings_repeat_nothing():
    robot = load_robot("servo_pendulum")
    cut = windows(robot, log_of(robot, hide(robot, (), None, 3), protocol(robot, seed=3, seconds=20.0)))
    assert len(repeated_windows(robot, cut.take(np.array([0])))) == 0
    other = np.arange(len(cut))[:, None] + cut.run.settings
    assert len(repeated_windows(robot, replace(cut, run=replace(cut.run, settings=other)))) == 0
