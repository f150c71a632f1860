"""Ingestion gives the channels on the robot's clock, and nothing that was not measured."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from dynreg.data.derivative import derivative
from dynreg.data.episodes import RawEpisode
from dynreg.data.ingest import doctor, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.recording import Recording
from dynreg.data.resample import resample
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import Series
from dynreg.data.table import read_parquet, write_parquet
from dynreg.data.transitions import transitions
from dynreg.errors import DynregError, LogError, MapError

Columns = dict[str, np.ndarray]


def irregular(seed: int, duration: float = 5.0, period: float = 0.0053) -> np.ndarray:
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, int(duration / period)) * period
    return np.cumsum(steps)


def test_a_name_that_is_no_text_becomes_one(write_table: Callable, swing: Columns, servo_spec, tmp_path):
    try:
        path = write_table(name=os.fsdecode(b"Pr\xfcfstand.csv"), **swing)
    except OSError:
        pytest.skip("this file system has names in UTF-8 alone")
    recording = read_recording(path, servo_spec)
    assert "Pr\\udcfcfstand" in recording.episodes[0].name
    assert recording.provenance["files"][0]["name"] == "Pr\\udcfcfstand.csv"
    write_parquet(recording, tmp_path / "kept")
    assert read_parquet(tmp_path / "kept").id == recording.id


def test_identity_map_keeps_order_units_and_settings(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    shuffled = {key: swing[key] for key in ("arm__target", "kp", "arm__velocity", "time", "arm__position")}
    recording = read_recording(write_table(**shuffled), servo_spec)
    assert recording.names == (
        "arm/position",
        "arm/velocity",
        "arm/target",
    )  # spec order; absent inputs left out
    (episode,) = recording.episodes
    assert episode.settings == {"kp": 400.0}
    np.testing.assert_allclose(episode.time, np.arange(401) / 100)
    np.testing.assert_allclose(episode.values[:, 0], np.sin(3 * episode.time), atol=1e-12)
    assert recording.provenance["files"][0]["name"] == "log.csv"


def test_irregular_stamps_are_interpolated_states_and_held_commands(
    write_table: Callable, servo_spec: RecordingSpec
):
    t = irregular(0)
    command = np.floor(4 * t)
    path = write_table(
        time=t,
        arm__position=np.sin(t),
        arm__velocity=np.cos(t),
        arm__target=0.1 * command,
        kp=np.ones(len(t)),
    )
    (episode,) = read_recording(path, servo_spec).episodes
    at = t[0] + episode.time
    np.testing.assert_allclose(episode.values[:, 0], np.interp(at, t, np.sin(t)), atol=1e-12)
    held = episode.values[:, 2]
    assert set(np.round(held / 0.1)) <= set(command)  # no value between two commands is invented
    late = np.floor(4 * at) - np.round(held / 0.1)
    assert late.min() >= 0 and late.mean() < 0.05  # a command acts from its stamp on, never before
    assert at[-1] <= t[-1] < at[-1] + 0.01


def test_several_clocks_share_their_common_span(tmp_path: Path, servo_spec: RecordingSpec):
    (tmp_path / "a_state.csv").write_text(
        "time,q\n" + "".join(f"{100 + k / 50},{k}e-3\n" for k in range(200))
    )
    (tmp_path / "a_cmd.csv").write_text("time,u\n" + "".join(f"{101 + k / 10},{k}e-3\n" for k in range(20)))
    text = """
        [channels."arm/position"]
        source = "s.q"
        [channels."arm/velocity"]
        derivative_of = "arm/position"
        [channels."arm/target"]
        source = "c.u"
        [settings.kp]
        value = 2.0
        [files]
        s = "_state.csv"
        c = "_cmd.csv"
    """
    recording = read_recording(
        [tmp_path / "a_state.csv", tmp_path / "a_cmd.csv"], servo_spec, parse_map(text)
    )
    (episode,) = recording.episodes
    assert episode.name == "a" and episode.settings == {"kp": 2.0}
    np.testing.assert_allclose(episode.values[:, 0], 0.05 + 0.05 * episode.time, atol=1e-9)
    np.testing.assert_allclose(episode.values[:, 1], 0.05, atol=1e-9)
    assert episode.values[0, 2] == 0.0 and episode.duration == pytest.approx(1.9, abs=1e-6)
    assert len(recording.provenance["files"]) == 2


def test_unit_scale_offset_delay(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    t = swing["time"]
    path = write_table(
        t_ms=1000 * t,
        angle=90 + np.degrees(np.sin(3 * (t - 0.05))),
        rate=3 * np.cos(3 * t) * 60 / (2 * np.pi),
        command=2 * swing["arm__target"],
    )
    text = """
        [map]
        time = "t_ms"
        time_unit = "ms"
        [channels."arm/position"]
        source = "angle"
        unit = "deg"
        offset = -90.0
        delay = 0.05
        [channels."arm/velocity"]
        source = "rate"
        unit = "rpm"
        [channels."arm/target"]
        source = "command"
        scale = 0.5
    """
    (episode,) = read_recording(path, servo_spec, parse_map(text)).episodes
    np.testing.assert_allclose(episode.values[:, 0], np.sin(3 * episode.time), atol=2e-4)
    np.testing.assert_allclose(episode.values[:, 1], 3 * np.cos(3 * episode.time), atol=2e-3)
    np.testing.assert_allclose(episode.values[:, 2], np.sin(3 * episode.time + 0.2), atol=0.02)


def test_episodes_by_column_may_restart_the_clock(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    n = len(swing["time"])
    twice = {key: np.concatenate([v, v]) for key, v in swing.items()}
    twice["kp"][n:] = 800.0
    recording = read_recording(write_table(**twice, episode=["slow"] * n + ["fast"] * n), servo_spec)
    assert [(e.name, e.settings["kp"]) for e in recording.episodes] == [("slow", 400.0), ("fast", 800.0)]
    np.testing.assert_array_equal(recording.episodes[0].values, recording.episodes[1].values)


@pytest.mark.parametrize("jump", [2.0, -1.5])
def test_episodes_by_gaps_split_at_silence_and_at_a_clock_that_runs_back(
    jump: float, write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    swing["time"] = np.concatenate([swing["time"][:400], swing["time"][400:] + jump])
    names = ("arm/position", "arm/velocity", "arm/target")
    text = (
        "".join(f'[channels."{n}"]\nsource = "{n}"\n' for n in names) + '[episodes]\nby = "gaps"\ngap = 0.5\n'
    )
    recording = read_recording(write_table(**swing), servo_spec, parse_map(text))
    assert [e.name for e in recording.episodes] == ["log_1", "log_2"]
    assert [len(e.time) for e in recording.episodes] == [200, 201]
    if jump < 0:
        with pytest.raises(LogError, match="runs back"):
            read_recording(write_table(**swing), servo_spec)


def test_names_and_settings_from_file_names(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    del swing["kp"]
    text = "".join(
        f'[channels."{n}"]\nsource = "{n}"\n' for n in ("arm/position", "arm/velocity", "arm/target")
    )
    text += '[settings.kp]\nfilename = "kp(\\\\d+)"\n[episodes]\nname = "gain{kp:.0f}"\n'
    paths = [write_table(f"run{i}_kp{kp}.csv", **swing) for i, kp in enumerate((100, 200, 100))]
    recording = read_recording(paths, servo_spec, parse_map(text))
    assert [e.name for e in recording.episodes] == ["gain100", "gain200", "gain100#2"]
    assert [e.settings["kp"] for e in recording.episodes] == [100, 200, 100]


def test_a_channel_that_only_some_episodes_have_is_nan_in_the_others(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    with_supply = write_table("a.csv", **swing, supply=np.full(len(swing["time"]), 7.4))
    recording = read_recording([with_supply, write_table("b.csv", **swing)], servo_spec)
    column = recording.names.index("supply")
    assert np.all(recording.episodes[0].values[:, column] == 7.4)
    assert np.isnan(recording.episodes[1].values[:, column]).all()
    rows = transitions(recording, ["arm/position"], ["arm/target"], ["supply", "kp"])
    assert set(rows.episode) == {0}  # rows without the input are left out


def test_timed_control_keeps_every_row_of_the_commands(write_table: Callable):
    spec = RecordingSpec(
        "cart", (ChannelSpec("base/x", "m", "state"), ChannelSpec("base/v", "m/s", "action")), (), None
    )
    t = irregular(4, duration=200.0, period=0.5)
    path = write_table(time=t, base__x=t**2, base__v=2 * t)
    (episode,) = read_recording(path, spec).episodes
    assert np.diff(t).max() > 0.5 and "gap" not in {f.check for f in doctor(path, spec)}
    assert "gap" in {f.check for f in doctor(path, replace(spec, rate=10.0))}
    np.testing.assert_allclose(episode.time, t - t[0], atol=1e-9)
    np.testing.assert_allclose(episode.values[:, 1], 2 * t)


def test_a_heading_of_timed_commands_is_not_unwrapped_from_row_to_row(write_table: Callable):
    spec = RecordingSpec(
        "cart", (ChannelSpec("base/yaw", "rad", "state"), ChannelSpec("base/v", "m/s", "action")), (), None
    )
    t = irregular(4, duration=200.0, period=0.5)
    turned = np.cumsum(np.random.default_rng(0).uniform(-4.0, 6.0, len(t)))
    within = (turned + np.pi) % (2 * np.pi) - np.pi
    for yaw, timed, found in (
        (turned, True, False),
        (turned, False, True),
        (within, True, False),
        (within, False, True),
        (np.degrees(turned), True, True),
    ):
        told = doctor(
            write_table(time=t, base__yaw=yaw, base__v=t), replace(spec, rate=None if timed else 2.0)
        )
        assert bool({f.check for f in told} & {"units", "wrap"}) == found


def test_a_clock_in_the_wrong_unit_does_not_fill_the_memory(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    swing["time"] = swing["time"] * 1e9
    path = write_table(**swing)
    with pytest.raises(LogError, match="time_unit"):
        read_recording(path, servo_spec)
    assert any(f.check == "span" for f in doctor(path, servo_spec))


def test_wrong_sources_list_what_there_is(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    names = ("arm/position", "arm/velocity", "arm/target")
    text = "".join(f'[channels."{n}"]\nsource = "{n}"\n' for n in names)
    with pytest.raises(MapError, match=r"'posn' for channel 'arm/position'.*'arm/position'"):
        read_recording(
            write_table(**swing),
            servo_spec,
            parse_map(text.replace('source = "arm/position"', 'source = "posn"')),
        )
    with pytest.raises(DynregError, match="at least one path"):
        read_recording([], servo_spec)


def test_derivative_recovers_a_planted_rate_through_noise():
    t = irregular(5, 10.0)
    noise = np.random.default_rng(6).normal(scale=1e-3, size=len(t))
    truth = 3 * np.cos(3 * t)
    rough = derivative(Series(t, np.sin(3 * t) + noise), None)
    smooth = derivative(Series(t, np.sin(3 * t) + noise), 10.0)
    error = smooth.values - 3 * np.cos(3 * smooth.time)
    inner = slice(50, -50)
    assert np.std(error[inner]) < 0.05 < np.std((rough.values - truth)[inner])
    assert abs(np.dot(error[inner], np.sin(3 * smooth.time[inner]))) / len(error) < 0.01  # no lag
    with pytest.raises(LogError, match="filter_hz"):
        derivative(Series(t, t), 500.0)


def test_same_numbers_same_id(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    a, b = (read_recording(write_table(name, **swing), servo_spec) for name in ("log.csv", "log.csv"))
    assert a.id == b.id and isinstance(a, Recording)


def test_transitions_span_no_two_episodes(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    recording = read_recording([write_table(f"{i}.csv", **swing) for i in range(3)], servo_spec)
    rows = transitions(recording, ["arm/velocity", "arm/position"], ["arm/target"], ["kp"])
    assert len(rows) == 3 * 400 and rows.states.dtype == np.float32
    values = recording.episodes[1].values.astype(np.float32)
    of = rows.episode == 1
    np.testing.assert_array_equal(rows.states[of], values[:-1, [1, 0]])
    np.testing.assert_array_equal(rows.next_states[of], values[1:, [1, 0]])
    np.testing.assert_array_equal(rows.actions[of], values[:-1, [2]])
    assert np.all(rows.context == 400.0) and not rows.states.flags.writeable
    with pytest.raises(LogError, match="'arm/torque' is missing"):
        transitions(recording, ["arm/torque"], [])
    with pytest.raises(LogError, match="neither an input nor a setting 'mass'"):
        transitions(recording, ["arm/position"], ["arm/target"], ["mass"])


def test_long_stretches_without_numbers_stay_empty(write_table, swing, servo_spec):
    """A straight line over them would be a motion that never was."""
    swing["arm__position"][200:300] = np.nan  # 1.0 to 1.5 s
    swing["arm__velocity"][400:410] = np.nan  # 0.05 s: a few lost messages
    swing["arm__target"][500:600] = np.nan  # 2.5 to 3.0 s
    values = read_recording(write_table(**swing), servo_spec).episodes[0].values
    position, velocity, target = (np.flatnonzero(np.isnan(values[:, c])) for c in range(3))
    assert position.tolist() == list(range(100, 150)) and not len(velocity)
    assert target.tolist() == list(range(250, 300))


@pytest.mark.parametrize("filter_hz", [None, 20.0])
@pytest.mark.parametrize("first", [np.nan, 5.0])
def test_the_rate_of_equal_stamps_is_that_of_their_last_rows(first: float, filter_hz: float | None):
    """A table in long form has a stamp for each of its signals: an empty cell stands before each number."""
    t = np.arange(400) / 100
    values = np.stack([np.full(400, first), np.sin(3 * t)], axis=1).ravel()
    slope = derivative(Series(np.repeat(t, 2), values), filter_hz)
    alone = derivative(Series(t, np.sin(3 * t)), filter_hz)
    slope = slope.rows(np.isfinite(slope.values))
    np.testing.assert_array_equal(slope.time, alone.time)
    np.testing.assert_array_equal(slope.values, alone.values)


def stepping(noise: float) -> tuple[Columns, np.ndarray]:
    """A log of an arm at 50 Hz whose speed leaps each second, and the speed; all are exact but for the noise."""
    time = np.arange(500) / 50.0
    speed = np.array([2.03, -3.11, 0.0, 1.07, -0.93])[(time.astype(int)) % 5]
    away = noise * np.random.default_rng(5).standard_normal(len(time))
    position = np.concatenate([[0.0], np.cumsum(speed[:-1]) / 50.0]) + away
    return {"time": time, "arm__position": position, "arm__target": np.sign(speed)}, speed


@pytest.mark.parametrize("filter_hz", [None, 10.0])
@pytest.mark.parametrize("noise", [0.0, 5e-4])
def test_no_rate_is_told_where_a_signal_turns_too_sharply(filter_hz: float | None, noise: float):
    log, speed = stepping(noise)
    found = derivative(Series(log["time"], log["arm__position"]), filter_hz)
    known = np.isfinite(found.values)
    leaps = np.flatnonzero(np.diff(speed)) + 1
    assert not known[leaps].any() and known.mean() > 0.8
    missed = np.abs(found.values - speed)[known]
    assert missed.max() < 0.35 and found.error < 0.1


@pytest.mark.parametrize("filter_hz", [None, 20.0])
@pytest.mark.parametrize("rate", [100.0, 500.0, 1000.0])
@pytest.mark.parametrize("noise", [1e-3, 1e-4])
def test_the_error_of_a_rate_is_that_of_its_noise(filter_hz: float | None, rate: float, noise: float):
    time = np.arange(int(20.0 * rate)) / rate
    away = noise * np.random.default_rng(3).standard_normal(len(time))
    found = derivative(Series(time, np.sin(2.0 * time) + away), filter_hz)
    missed = np.sqrt(np.nanmean((found.values - 2.0 * np.cos(2.0 * time))[50:-50] ** 2))
    assert np.isfinite(found.values).mean() > 0.999 and 0.6 < missed / found.error < 1.6


@pytest.mark.parametrize("filter_hz", [None, 10.0])
@pytest.mark.parametrize("moving", [0.3, 0.45, 0.8])
def test_a_coarse_encoder_that_rests_keeps_its_rates(filter_hz: float | None, moving: float):
    time = np.arange(6000) / 100.0
    phase = np.minimum(time % 20.0, 20.0 * moving) / (20.0 * moving)  # up and down, then it rests
    position = np.round(0.5 * (1.0 - np.cos(2.0 * np.pi * phase)) / 0.00153) * 0.00153
    found = derivative(Series(time, position), filter_hz)
    assert np.isfinite(found.values).mean() > 0.98


def test_rows_that_a_filter_makes_up_in_a_silence_decide_nothing():
    time = np.concatenate([np.arange(1000), 10_000 + np.arange(1000)]) / 100.0
    noise = 1e-3 * np.random.default_rng(4).standard_normal(len(time))
    found = derivative(Series(time, np.sin(time) + noise), 10.0)
    known = found.time[np.isfinite(found.values)]
    assert len(known) > 1960 and not ((known > 10.0) & (known < 99.99)).any()


def test_rates_stay_where_a_filter_is_too_slow_for_all_of_a_signal():
    time = np.arange(500) / 50.0
    found = derivative(Series(time, np.sin(2 * np.pi * 5.0 * time)), 1.0)
    assert np.isfinite(found.values).all() and found.error > 10.0  # of a rate of 31 rad/s at most


def test_a_row_whose_rate_is_not_known_stays_unknown(write_table: Callable, servo_spec: RecordingSpec):
    log, speed = stepping(5e-4)
    text = '[channels."arm/position"]\nsource = "arm/position"\n[channels."arm/velocity"]\n'
    text += 'derivative_of = "arm/position"\nfilter_hz = 10\n[channels."arm/target"]\nsource = "arm/target"\n'
    recording = read_recording(write_table(**log), replace(servo_spec, rate=50.0), parse_map(text))
    (episode,) = recording.episodes
    assert len(episode.time) == len(speed)  # the first row, whose rate is in doubt, is one of the log
    velocity = episode.values[:, recording.names.index("arm/velocity")]
    lost = np.isnan(velocity)
    assert lost[np.flatnonzero(np.diff(speed)) + 1].all() and lost.mean() < 0.2
    findings = [
        f for f in recording.provenance["findings"] if f["check"] == "rate" and "known" in f["message"]
    ]
    (told,) = findings
    assert (told["severity"], told["message"][:13]) == ("info", f"{lost.sum()} of 500 rat")
    found = {f["check"] for f in recording.provenance["findings"] if f["severity"] == "warning"}
    assert found == {"missing"}  # the setting


@pytest.mark.parametrize("filter_hz", [None, 20.0])
def test_where_a_signal_is_silent_for_long_it_has_no_rate(filter_hz: float | None):
    t = np.arange(801) / 200
    values = np.sin(3 * t)
    values[200:300] = np.nan  # 1.0 to 1.5 s
    values[400:410] = np.nan  # 0.05 s
    slope = derivative(Series(t, values), filter_hz)
    assert (np.diff(slope.time) > 0).all()
    lost = slope.time[np.isnan(slope.values)]
    assert set(range(201, 299)) <= set(np.round(lost * 200).astype(int))
    assert 0.98 < lost[0] < 1.006 and 1.494 < lost[-1] < 1.52  # a filter reaches some rows beyond
    assert np.diff(lost) == pytest.approx(0.005)


def test_slow_signals_and_commands_logged_on_change_are_filled_in(write_table, swing, servo_spec):
    rows = np.arange(len(swing["time"]))
    swing["arm__velocity"][rows % 100 != 0] = np.nan  # a sensor of 2 Hz in a table of 200 Hz
    swing["arm__target"][~np.isin(rows, (0, 10, 20, 500))] = np.nan
    values = read_recording(write_table(**swing), servo_spec).episodes[0].values
    assert np.isfinite(values).all()
    assert len(np.unique(values[:, 2])) == 4


def clocked(tmp_path: Path, name: str, start: float, seconds: float = 1.0) -> Path:
    """A log that needs no map, whose clock begins at `start` [s]."""
    rows = "".join(f"{start + 0.01 * k!r},{k},0,0\n" for k in range(round(100 * seconds) + 1))
    (tmp_path / name).write_text("time,arm/position,arm/velocity,arm/target\n" + rows)
    return tmp_path / name


def test_logs_are_ordered_by_their_clocks_and_the_rests_between_them_stay(tmp_path: Path, servo_spec):
    spec = replace(servo_spec, channels=tuple(replace(c, low=None, high=None) for c in servo_spec.channels))
    day = 1_700_000_000.0
    logs = [
        clocked(tmp_path, name, day + at) for name, at in (("b.csv", 60.0), ("c.csv", 100.5), ("a.csv", 0.0))
    ]
    recording = read_recording(logs, spec)
    assert [e.name for e in recording.episodes] == ["a", "b", "c"]
    assert [e.time[0] for e in recording.episodes] == pytest.approx([0.0, 60.0, 100.5], abs=1e-6)
    assert recording.provenance["clocks"] == pytest.approx({"a": day, "b": day + 60, "c": day + 100.5})
    assert any("ordered by their clocks" in f["message"] for f in recording.provenance["findings"])
    again = read_recording(logs[::-1], spec)
    assert again.id == recording.id


def test_clocks_that_start_anew_are_said_and_the_order_given_stands(tmp_path: Path, servo_spec):
    spec = replace(servo_spec, channels=tuple(replace(c, low=None, high=None) for c in servo_spec.channels))
    logs = [clocked(tmp_path, name, at) for name, at in (("b.csv", 0.02), ("a.csv", 0.0))]
    recording = read_recording(logs, spec)
    assert [e.name for e in recording.episodes] == ["b", "a"]
    assert [e.time[0] for e in recording.episodes] == [0.0, 0.0]
    (told,) = [f for f in recording.provenance["findings"] if "anew" in f["message"]]
    assert told["severity"] == "info" and "in the order given" in told["message"]


def free(spec: RecordingSpec) -> RecordingSpec:
    """The spec without limits."""
    return replace(spec, channels=tuple(replace(c, low=None, high=None) for c in spec.channels))


def test_of_two_clocks_that_overlap_only_the_rest_between_these_is_lost(tmp_path: Path, servo_spec):
    begins = {"e.csv": 5010.0, "d.csv": 5000.9, "c.csv": 5000.0, "f.csv": 5020.0}
    recording = read_recording([clocked(tmp_path, name, at) for name, at in begins.items()], free(servo_spec))
    assert [e.name for e in recording.episodes] == ["c", "d", "e", "f"]
    assert [e.time[0] for e in recording.episodes] == pytest.approx([0.0, 0.0, 9.1, 19.1], abs=1e-6)
    assert recording.begins() == pytest.approx([0.0, 1.0, 10.1, 20.1], abs=1e-6)
    (told,) = [f for f in recording.provenance["findings"] if "overlap" in f["message"]]
    assert told["severity"] == "warning" and "by 0.1 s" in told["message"]
    assert told["where"] == "c.csv and d.csv"


def test_many_logs_that_overlap_are_told_in_one_line(tmp_path: Path, servo_spec):
    """Each of three pairs by itself; of four the first, and how many more there are."""
    logs = [clocked(tmp_path, f"{k}.csv", 1.7e9 + 0.5 * k) for k in range(5)]
    for many, expected in ((4, ["", "", ""]), (5, ["3 more pairs of logs"])):
        found = read_recording(logs[:many], free(servo_spec)).provenance["findings"]
        told = [f for f in found if "overlap" in f["message"]]
        assert len(told) == len(expected) and told[0]["where"] == "0.csv and 1.csv"
        assert all(more in f["message"] for f, more in zip(told, expected, strict=True))
        assert ("more pairs" in told[0]["message"]) == (many == 5)


def test_a_clock_from_zero_is_not_compared_with_an_absolute_one(tmp_path: Path, servo_spec):
    """By their numbers alone the log from zero would be the first, and the rest before the other 54 years."""
    logs = [
        clocked(tmp_path, name, at) for name, at in (("b.csv", 1.7e9), ("c.csv", 1.7e9 + 9.0), ("a.csv", 5.0))
    ]
    recording = read_recording(logs, free(servo_spec))
    assert [e.name for e in recording.episodes] == ["b", "c", "a"]
    assert [e.time[0] for e in recording.episodes] == [0.0, 0.0, 0.0]
    (told,) = [f for f in recording.provenance["findings"] if "count from different times" in f["message"]]
    assert told["severity"] == "warning" and told["where"] == "a.csv" and "b.csv" in told["message"]
    assert told in [vars(f) for f in doctor(logs, free(servo_spec))]
    assert any("count from different times" in f.message for f in doctor(logs))


def test_the_episodes_of_a_log_stay_together_where_each_log_starts_anew(tmp_path: Path, servo_spec):
    """Two logs of two runs each, with 9 s between: by their clocks the runs of one would lie in those of the other."""
    text = "".join(
        f'[channels."{n}"]\nsource = "{n}"\n' for n in ("arm/position", "arm/velocity", "arm/target")
    )
    for name in "ab":
        first, second = (clocked(tmp_path, part, at).read_text() for part, at in (("1", 0.0), ("2", 10.0)))
        (tmp_path / f"{name}.csv").write_text(first + second.split("\n", 1)[1])
    logs = [tmp_path / "a.csv", tmp_path / "b.csv"]
    recording = read_recording(logs, free(servo_spec), parse_map(text + '[episodes]\nby = "gaps"\n'))
    assert [e.name for e in recording.episodes] == ["a_1", "a_2", "b_1", "b_2"]
    assert recording.begins() == pytest.approx([0.0, 10.0, 11.0, 21.0])


def test_doctor_tells_the_rests_between_logs(tmp_path: Path, servo_spec):
    logs = [
        clocked(tmp_path, name, 1.7e9 + at)
        for name, at in (("b.csv", 60.0), ("c.csv", 100.5), ("a.csv", 0.0))
    ]
    for told in (doctor(logs, free(servo_spec)), doctor(logs)):
        (rests,) = [f for f in told if "rests between the logs" in f.message]
        assert rests.severity == "info" and "59 s before b.csv, 39.5 s before c.csv" in rests.message
    assert not [f for f in doctor(logs[:1]) if f.check == "clock"]


def test_the_rests_reach_what_drifts(tmp_path: Path):
    """A simulator's clock goes on over the rest between two logs: friction that drifts is by so much the higher."""
    import dynreg
    from dynreg.replay.rows import rows_of

    robot = dynreg.load_robot("servo_pendulum")
    logs = [clocked(tmp_path, name, at) for name, at in (("b.csv", 1030.0), ("a.csv", 1000.0))]
    spec = robot.recording_spec
    free = replace(spec, channels=tuple(replace(c, low=None, high=None) for c in spec.channels))
    assert rows_of(robot, read_recording(logs, free)).begin == pytest.approx([0.0, 30.0])


@pytest.mark.parametrize("by_rate", [False, True])
def test_rows_that_are_missing_are_not_made_up(
    by_rate: bool, write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    rows = np.delete(np.arange(801), np.arange(200, 280))  # none from 1.0 to 1.4 s
    kept = {name: column[rows] for name, column in swing.items()}
    entry = 'derivative_of = "arm/position"\nfilter_hz = 20\n' if by_rate else 'source = "arm/velocity"\n'
    text = f'[channels."arm/position"]\nsource = "arm/position"\n[channels."arm/velocity"]\n{entry}'
    text += '[channels."arm/target"]\nsource = "arm/target"\n'
    (episode,) = read_recording(write_table(**kept), servo_spec, parse_map(text)).episodes
    empty = np.isnan(episode.values)
    position, velocity, target = (episode.time[empty[:, c]] for c in range(3))
    assert position[0] == pytest.approx(1.0) and position[-1] == pytest.approx(1.39)
    assert len(position) == 40 and not len(target)  # a command holds
    assert set(position) <= set(velocity) and len(velocity) <= len(position) + 3


def apart(tmp_path: Path, time: np.ndarray, sent: np.ndarray, target: np.ndarray) -> tuple[list[Path], str]:
    """States at `time` and commands at `sent` [s] in two files, and the map of both."""
    np.savez(tmp_path / "state.npz", time=time, position=np.sin(time), velocity=np.cos(time))
    np.savez(tmp_path / "told.npz", time=sent, target=target)
    text = (
        '[files]\ns = "state.npz"\nc = "told.npz"\n[channels."arm/position"]\nsource = "s.position"\n'
        '[channels."arm/velocity"]\nsource = "s.velocity"\n[channels."arm/target"]\nsource = "c.target"\n'
    )
    return [tmp_path / "state.npz", tmp_path / "told.npz"], text


@pytest.mark.parametrize("stream", [False, True])
def test_commands_logged_on_change_stand_and_a_stream_ends(
    stream: bool, tmp_path: Path, servo_spec: RecordingSpec
):
    sent = np.arange(0.0, 4.001, 0.01) if stream else np.array([0.0, 2.0, 4.0])
    paths, text = apart(tmp_path, np.arange(0.0, 20.005, 0.01), sent, np.sin(sent))
    recording = read_recording(paths, servo_spec, parse_map(text))
    (episode,) = recording.episodes
    cut = [f["message"] for f in recording.provenance["findings"] if f["check"] == "span"]
    assert cut == [f.message for f in doctor(paths, servo_spec, parse_map(text)) if f.check == "span"]
    if stream:
        assert episode.time[-1] == pytest.approx(4.0)
        assert cut[0].startswith("16 of 20 s are left out") and "'arm/target' ends at 4.000 s" in cut[0]
    else:
        assert episode.time[-1] == pytest.approx(20.0) and len(cut) == 1
        assert cut[0].startswith("the last command comes at 4.000 s and is taken to hold for 16 s")
        assert episode.values[-1, 2] == pytest.approx(np.sin(4.0))


def test_a_command_that_stands_before_a_piece_stands_at_its_begin(tmp_path: Path, servo_spec: RecordingSpec):
    time = np.concatenate([np.arange(0.0, 5.0, 0.01), np.arange(8.0, 14.0, 0.01)])
    paths, text = apart(tmp_path, time, np.array([0.0, 2.0]), np.array([0.1, 0.2]))
    log_map = parse_map(text + '[episodes]\nby = "gaps"\ngap = 0.5\n')
    first, second = read_recording(paths, servo_spec, log_map).episodes
    assert [len(first.time), len(second.time)] == [500, 600]
    assert (second.values[:, 2] == 0.2).all() and set(first.values[:, 2]) == {0.1, 0.2}


def test_a_command_of_the_same_table_stands_over_a_gap(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    rows = np.delete(np.arange(801), np.arange(300, 500))  # none from 1.5 to 2.5 s
    swing["arm__target"] = np.where(np.isin(np.arange(801), (0, 200, 760)), 0.01 * np.arange(801), np.nan)
    text = "".join(f'[channels."arm/{n}"]\nsource = "arm/{n}"\n' for n in ("position", "velocity", "target"))
    log_map = parse_map(text + '[episodes]\nby = "gaps"\ngap = 0.5\n')
    table = write_table(**{name: column[rows] for name, column in swing.items()})
    _, second = read_recording(table, servo_spec, log_map).episodes
    assert len(second.time) == 151 and second.values[[0, -1], 2] == pytest.approx([2.0, 7.6])


def test_an_input_that_is_logged_when_it_changes_is_not_empty(tmp_path: Path, servo_spec: RecordingSpec):
    paths, text = apart(tmp_path, np.arange(0.0, 20.0, 0.01), np.arange(0.0, 20.0, 0.01), np.zeros(2000))
    told = np.array([0.0, 1.0, 2.0, 15.0, 19.99])
    np.savez(tmp_path / "supply.npz", time=told, volts=7.0 + 0.01 * told)
    text = (
        text.replace("[files]\n", '[files]\nv = "supply.npz"\n') + '[channels.supply]\nsource = "v.volts"\n'
    )
    (episode,) = read_recording([*paths, tmp_path / "supply.npz"], servo_spec, parse_map(text)).episodes
    assert np.isfinite(episode.values).all()


def test_an_optional_channel_without_a_number_is_left_out(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    recording = read_recording(write_table(**swing, supply=np.full(801, np.nan)), servo_spec)
    assert "supply" not in recording.names
    (found,) = [f for f in recording.provenance["findings"] if f["check"] == "nan"]
    assert found["severity"] == "warning" and "left out" in found["message"]


def test_a_setting_in_a_text_column_is_that_of_its_episode(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    half = np.arange(801) < 400
    del swing["kp"]
    text = "".join(f'[channels."arm/{n}"]\nsource = "arm/{n}"\n' for n in ("position", "velocity", "target"))
    text += '[settings.kp]\nmetadata = "gain"\n[episodes]\nby = "column"\ncolumn = "run"\n'
    swing |= {"run": np.where(half, "a", "b"), "gain": np.where(half, "0.5 ", "1.5 ")}
    path = write_table(**swing).with_suffix(".parquet")
    pq.write_table(pa.table({name.replace("__", "/"): column for name, column in swing.items()}), path)
    assert [e.settings["kp"] for e in read_recording(path, servo_spec, parse_map(text)).episodes] == [
        0.5,
        1.5,
    ]
    swing["gain"][10] = "0.7 "
    pq.write_table(pa.table({name.replace("__", "/"): column for name, column in swing.items()}), path)
    with pytest.raises(LogError, match="'0.5 ' and '0.7 ' in one episode"):
        read_recording(path, servo_spec, parse_map(text))


def test_a_rate_that_is_not_known_at_the_ends_cuts_nothing_off(servo_spec: RecordingSpec):
    time = np.arange(500) / 50.0
    rate = np.cos(time)
    rate[:20] = rate[-20:] = np.nan
    channels = {
        "arm/position": Series(time, np.sin(time)),
        "arm/velocity": replace(Series(time, rate), error=0.01),
        "arm/target": Series(time, np.sin(time)),
    }
    start, grid, values = resample(RawEpisode("1", "log.csv", channels), servo_spec)
    assert start == 0.0 and grid[-1] == pytest.approx(time[-1], abs=0.03)
    column = [c.name for c in servo_spec.channels].index("arm/velocity")
    assert np.isnan(values[0, column]) and np.isnan(values[-1, column]) and np.isfinite(values[100, column])


def heard(spec: RecordingSpec, sent: np.ndarray, told: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """When a log begins, its grid, and the commands there: sent at stamps (T,), beside states at other stamps."""
    t = np.arange(600) / 100
    signals = {
        "arm/position": Series(t, np.sin(t), "rad"),
        "arm/velocity": Series(t, np.cos(t), "rad/s"),
        "arm/target": Series(sent, told, "rad"),
    }
    start, time, values = resample(RawEpisode("run", "run.csv", signals, {"kp": 400.0}), spec)
    return start, time, values[:, [c.name for c in spec.channels].index("arm/target")]


@pytest.mark.parametrize("late", [0.0, 0.005])
@pytest.mark.parametrize("scatter", [0.0, 0.0004, 0.001])
@pytest.mark.parametrize("offset", [0.0, 0.004, 0.0075])
@pytest.mark.parametrize("rows", [1, 2])
def test_stamps_that_scatter_move_no_command_to_another_row(
    rows: int, offset: float, scatter: float, late: float, servo_spec: RecordingSpec
):
    """A command counts for the nearest row of the grid, at whatever part of a period it comes; each row has its own.

    rows : of the log for each command, which is sent 100 times a second. late : by which one of them comes late.
    """
    rng, t = np.random.default_rng(5), np.arange(600 * rows) / (100 * rows)
    stamps = np.sort(t + offset + np.clip(rng.normal(0.0, scatter, len(t)), -3 * scatter, 3 * scatter) / rows)
    stamps[300 * rows] += late * (rows == 1)
    told = np.repeat(rng.normal(size=600), rows)
    start, _, found = heard(servo_spec, stamps, told)
    first = round((start - offset) * 100)
    wrong = np.flatnonzero(found != told[::rows][first : first + len(found)])
    assert len(wrong) <= (late > 0), wrong


@pytest.mark.parametrize("sent", [irregular(2), irregular(2)[::200], np.arange(1200) / 200 + 0.001])
def test_commands_that_come_seldom_or_at_any_time_count_from_the_next_row_on(
    sent: np.ndarray, servo_spec: RecordingSpec
):
    told = np.arange(len(sent), dtype=float)
    start, time, found = heard(servo_spec, sent, told)
    last = np.searchsorted(sent, start + time + 1e-6, side="right") - 1
    np.testing.assert_array_equal(found, told[np.maximum(last, 0)])


def test_what_one_message_tells_lies_in_one_row(servo_spec: RecordingSpec):
    """A joint that is told another target in each message, and one that is told so once."""
    two = ChannelSpec(name="wrist/target", unit="rad", kind="action")
    spec = replace(servo_spec, channels=(*servo_spec.channels, two))
    t = np.arange(600) / 100
    sent = t + np.random.default_rng(3).uniform(-0.001, 0.001, len(t))
    told = np.random.default_rng(4).normal(size=600)
    signals = {
        "arm/position": Series(t, np.sin(t), "rad"),
        "arm/velocity": Series(t, np.cos(t), "rad/s"),
        "arm/target": Series(sent, told, "rad"),
        "wrist/target": Series(sent, (np.arange(600) >= 300).astype(float), "rad"),
    }
    _, _, values = resample(RawEpisode("run", "run.csv", signals, {"kp": 400.0}), spec)
    names = [c.name for c in spec.channels]
    row = int(np.argmax(values[:, names.index("wrist/target")] == 1.0))
    assert values[row, names.index("arm/target")] == told[300]
