"""Each fault planted in a good log is found, where it is, and a good log has none."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.checks.motion import velocities, velocity_slope
from dynreg.data.checks.numbers import check_numbers
from dynreg.data.checks.runs import longest_run
from dynreg.data.episodes import RawEpisode
from dynreg.data.ingest import doctor, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import Series
from dynreg.errors import LogError, MapError

Columns = dict[str, np.ndarray]
COUNTS = "(radians per count) and offset = ... (so that the joint's zero is 0)"


def clock_back(c: Columns) -> None:
    c["time"][400:] -= 0.5


def clock_stops(c: Columns) -> None:
    c["time"][300:330] = c["time"][300]


def repeated_stamp(c: Columns) -> None:
    c["time"][300] = c["time"][299]


def gap(c: Columns) -> None:
    c["time"][500:] += 0.8


def nans(c: Columns) -> None:
    c["arm__position"][100:110] = np.nan


def infinite(c: Columns) -> None:
    c["arm__velocity"][7] = np.inf


def only_nan(c: Columns) -> None:
    c["arm__velocity"][:] = np.nan


def degrees(c: Columns) -> None:
    c["arm__position"] *= 180 / np.pi


def rpm(c: Columns) -> None:
    c["arm__velocity"] *= 60 / (2 * np.pi)


def flipped(c: Columns) -> None:
    c["arm__velocity"] *= -1


def beyond(c: Columns) -> None:
    c["arm__target"] *= 3.5


def stuck(c: Columns) -> None:
    c["arm__position"][300:] = c["arm__position"][300]
    c["arm__velocity"][300:] = 0


def wrapped(c: Columns) -> None:
    turning = 3 * c["time"]
    c["arm__position"] = np.angle(np.exp(1j * turning))
    c["arm__velocity"][:] = 3.0


def wrapped_fast(c: Columns) -> None:
    c["arm__position"] = np.angle(np.exp(1j * 200 * c["time"]))  # a rad from row to row
    c["arm__velocity"][:] = 200.0


def missing(c: Columns) -> None:
    del c["arm__target"]


def milliseconds(c: Columns) -> None:
    c["time"] *= 1000


def nan_time(c: Columns) -> None:
    c["time"][5] = np.nan


def spike(c: Columns) -> None:
    c["arm__position"][300] += 0.3


def stuck_alone(c: Columns) -> None:
    c["arm__position"][300:] = c["arm__position"][300]


def nanoseconds(c: Columns) -> None:
    c["time"] = (c["time"] * 1e9).astype(int)


def test_a_servo_that_is_held_or_has_settled_is_not_stuck(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    """Friction holds it while its command moves on one side; then its drive is off while the command moves."""
    t = swing["time"]
    swing["arm__target"] = np.where(t > 1.5, 1.5 + 0.2 * np.sin(3 * t), swing["arm__target"])
    for name, rest in (("arm__position", 1.2), ("arm__velocity", 0.0)):
        swing[name] = np.where(t > 1.7, rest, swing[name])
    assert not [f for f in doctor(write_table(**swing), servo_spec) if f.check == "stuck"]
    swing["arm__target"] = 3.0 * np.sin(3 * t)
    swing["arm__enabled"] = (t < 1.7).astype(float)
    assert not [f for f in doctor(write_table(**swing), servo_spec) if f.check == "stuck"]


def test_what_is_no_flag_is_refused(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    """A position taken for the flag would switch its drive off in every replay."""
    swing["arm__enabled"] = 0.4 * np.sin(swing["time"])
    (found,) = [f for f in doctor(write_table(**swing), servo_spec) if f.severity == "error"]
    assert found.check == "units" and "a flag with values other than 0 and 1, such as" in found.told
    swing["arm__enabled"] = np.where(swing["time"] < 1.0, np.nan, 1.0)
    assert not [f for f in doctor(write_table(**swing), servo_spec) if f.severity == "error"]


def test_no_spikes_in_what_real_signals_do(write_table: Callable):
    """Steps, ramps, coarse sensors, noise and oscillations at the fastest that can be sampled have none."""
    rng, t = np.random.default_rng(0), 0.01 * np.arange(2000)
    signals = {
        "steps": np.sign(np.sin(2 * t)),
        "noise": rng.normal(size=2000),
        "coarse": np.round(np.sin(t) / 0.05) * 0.05,
        "flicker": np.where(rng.random(2000) < 0.01, 0.001, 0.0),
        "fast": np.tile([1.0, -1.0], 1000),
        "chirp": np.sin(3 * t**2),
        "still": np.zeros(2000),
    }
    assert not [f for f in doctor(write_table(time=t, **signals)) if f.check == "spike"]


def test_spikes_are_found_where_they_are(write_table: Callable):
    rng, t = np.random.default_rng(1), 0.01 * np.arange(2000)
    q = np.sin(t) + rng.normal(size=2000) * 1e-3
    rows = [200, 777, 1500]
    q[rows] += [0.3, -0.2, 0.5]
    (found,) = [f for f in doctor(write_table(time=t, q=q)) if f.check == "spike"]
    assert "row 200" in found.where and "3 single-sample spikes (at 2.000 s, 7.770 s, 15.000 s)" in found.told
    assert "at 15.000 s;" in found.told
    assert found.told.endswith('write outliers = "drop" in the map under the channel that has source = "q"')


def test_the_cure_for_spikes_names_the_table_of_the_map(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    """As text to be pasted; with it the spikes are gone."""
    swing["arm__position"][300] += 0.3
    path = write_table(**swing)
    told = [f["do"] for f in read_recording(path, servo_spec).provenance["findings"]]
    for do in (*told, *(f.do for f in doctor(path, servo_spec) if f.check == "spike")):
        cure, header = re.findall(r'write (.*) in the map under (\[channels."arm/position"\])$', do)[0]
    names = ("arm/position", "arm/velocity", "arm/target")
    text = "".join(f'[channels."{name}"]\nsource = "{name}"\n' for name in names)
    cured = parse_map(text.replace(f"{header}\n", f"{header}\n{cure}\n") + "[settings.kp]\nvalue = 1.0\n")
    assert not [f for f in doctor(path, servo_spec, cured) if f.check == "spike"]


def test_spikes_of_a_position_are_no_finding_on_its_velocity(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    """A bus that loses a sample now and then told of a velocity that is a hundredth of what it should be."""
    still = 0.02 * np.sin(3 * swing["time"])
    swing |= {"arm__position": still, "arm__velocity": 0.06 * np.cos(3 * swing["time"])}
    swing["arm__target"] *= 0.02
    swing["arm__position"][20::20] += 0.03 * swing["time"][20::20]
    found = doctor(write_table(**swing), servo_spec)
    assert {f.check for f in found} == {"spike"}


def test_a_clock_in_another_unit_is_named(write_table: Callable, swing: Columns):
    for unit, factor in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        columns = swing | {"time": np.rint(swing["time"] * factor).astype(int)}
        found = doctor(write_table(**columns))
        assert any(f'time_unit = "{unit}"' in f.told for f in found), (unit, found)
        assert not any(f.check == "jitter" for f in found)


FAULTS = [
    (clock_back, "error", "clock", "row 400"),
    (clock_stops, "error", "clock", "row 300"),
    (repeated_stamp, "warning", "clock", "row 299"),
    (nan_time, "warning", "clock", "row 5"),
    (spike, "warning", "spike", "arm/position, row 300"),
    (stuck_alone, "warning", "stuck", "arm/position, row 300"),
    (nanoseconds, "warning", "clock", "log.csv"),
    (gap, "warning", "gap", "row 500"),
    (nans, "warning", "nan", "arm/position, row 100"),
    (infinite, "warning", "nan", "arm/velocity, row 7"),
    (only_nan, "error", "nan", "arm/velocity"),
    (degrees, "error", "units", "arm/position"),
    (rpm, "error", "units", "arm/velocity"),
    (flipped, "warning", "units", "arm/velocity"),
    (beyond, "warning", "limits", "arm/target"),
    (stuck, "warning", "stuck", "arm/position, row 300"),
    (wrapped, "warning", "wrap", "arm/position, row 210"),
    (wrapped_fast, "warning", "wrap", "arm/position, row 4"),
    (missing, "error", "map", "log.csv"),
    (milliseconds, "warning", "rate", "log.csv"),
]


def test_a_good_log_has_no_findings(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    assert doctor(write_table(**swing), servo_spec) == ()


@pytest.mark.parametrize(("spoil", "severity", "check", "where"), FAULTS, ids=[f[0].__name__ for f in FAULTS])
def test_planted_fault_is_found(
    spoil: Callable,
    severity: str,
    check: str,
    where: str,
    write_table: Callable,
    swing: Columns,
    servo_spec: RecordingSpec,
):
    spoil(swing)
    path = write_table(**swing)
    findings = doctor(path, servo_spec)
    assert any(f.severity == severity and f.check == check and where in f.where for f in findings), findings
    if severity == "error":
        with pytest.raises(LogError if check != "map" else MapError, match="expected"):
            read_recording(path, servo_spec)


def stopped(spec: RecordingSpec) -> RecordingSpec:
    """The robot with a model whose joint stops at +-1.1 rad, in place of limits in robot.toml."""
    channels = (replace(c, low=None, high=None) for c in spec.channels)
    return replace(
        spec,
        channels=tuple(replace(c, stops=(-1.1, 1.1)) if c.name == "arm/position" else c for c in channels),
    )


def test_degrees_are_told_by_the_stops_of_the_model(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    degrees(swing)
    found = doctor(write_table(**swing), stopped(servo_spec))
    (told,) = [f for f in found if f.check == "units" and "its limit" in f.told]
    assert told.severity == "error" and "arm/position" in told.where and "52.1 x its limit; deg" in told.told


@pytest.mark.parametrize(
    ("size", "step", "told", "do"),
    [
        (2048.0, 1.0, "which the joint cannot do in degrees either", COUNTS),
        (2048.0, 0.1, "which the joint cannot do in degrees either", COUNTS),
        (90.0, 1.0, "in whole numbers", f'{COUNTS}, or unit = "deg"'),
    ],
)
@pytest.mark.parametrize("limits", ["stated", "stops", "none"])
def test_counts_of_an_encoder_are_told_as_a_draft_tells_them(
    limits: str,
    size: float,
    step: float,
    told: str,
    do: str,
    write_table: Callable,
    swing: Columns,
    servo_spec: RecordingSpec,
):
    """They were asked about as degrees, which they would still be too large for."""
    spec = servo_spec if limits == "stated" else stopped(servo_spec)
    if limits == "none":
        spec = replace(spec, channels=tuple(replace(c, stops=None) for c in spec.channels))
    swing["arm__position"] = np.round(size * swing["arm__position"] / step) * step
    found = doctor(write_table(**swing), spec)
    (said,) = [
        f.told for f in found if f.check == "units" and "arm/position" in f.where and "reaches" in f.message
    ]
    if limits == "none" and step < 1.0:
        assert said.endswith("turns: degrees?"), "nothing tells how far it goes"
    elif limits == "none":
        assert f', in whole numbers: counts of an encoder?; set scale = ... {COUNTS}, or unit = "deg"' in said
    else:
        assert said.endswith(f", {told}: counts of an encoder?; set scale = ... {do}")


def test_targets_in_degrees_are_refused_as_positions_are(
    write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    swing["arm__target"] = np.degrees(swing["arm__target"])
    spec = stopped(servo_spec)
    with pytest.raises(LogError, match="arm/target: reaches .* x its limit; degrees.*; set `unit`"):
        read_recording(write_table(**swing), spec)
    free = replace(spec, channels=tuple(replace(c, stops=None) for c in spec.channels))
    assert not [f for f in doctor(write_table(**swing), free) if f.severity == "error"]


def moved(c: Columns) -> None:
    c["arm__position"] += 2 * np.pi


def pressed(c: Columns) -> None:
    for name in ("arm__position", "arm__velocity", "arm__target"):
        c[name] *= 1.2


def lost(c: Columns) -> None:
    c["arm__position"][300:304] = 6553.5


@pytest.mark.parametrize("sound", [moved, pressed, lost])
def test_stops_of_the_model_tell_of_units_alone(
    sound: Callable, write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    """An encoder whose zero is a turn away, a joint pressed into its soft stop, a bus that fails for four rows."""
    sound(swing)
    found = doctor(write_table(**swing), stopped(servo_spec))
    assert not [f for f in found if f.check == "limits" or f.severity == "error"], found


def test_ingest_error_points_to_the_doctor(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    clock_back(swing)
    with pytest.raises(LogError, match=r"log\.csv.*row 400: the clock runs back by 0\.495.*dynreg doctor"):
        read_recording(write_table(**swing), servo_spec)


def test_warnings_go_to_the_provenance(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    nans(swing)
    recording = read_recording(write_table(**swing), servo_spec)
    assert [f["check"] for f in recording.provenance["findings"]] == ["nan"]
    assert np.isfinite(recording.episodes[0].values).all()


def test_doctor_without_a_robot(write_table: Callable, swing: Columns, tmp_path: Path):
    clock_back(swing)
    nans(swing)
    checks = {f.check for f in doctor(write_table(**swing))}
    assert checks == {"clock", "nan"}
    (finding,) = doctor(tmp_path / "nothing.mcap")
    assert (finding.severity, finding.check) == ("error", "log") and "no log" in finding.told


def test_a_log_given_twice_is_refused(write_table: Callable, swing: Columns, servo_spec: RecordingSpec):
    path = write_table(**swing)
    for read in (doctor, read_recording):
        with pytest.raises(LogError, match=r"log\.csv' is given twice; expected each log once"):
            read([path, path.parent / "." / path.name], servo_spec)


def test_velocity_slope_sees_through_encoder_steps():
    t = np.sort(np.random.default_rng(0).uniform(0, 10, 2000))
    position = Series(t, np.round(np.sin(2 * t) / 0.00153) * 0.00153)
    assert velocity_slope(position, Series(t, 2 * np.cos(2 * t))) == pytest.approx(1.0, abs=0.02)
    assert velocity_slope(position, Series(t, 114.6 * np.cos(2 * t))) == pytest.approx(57.3, rel=0.02)
    assert velocity_slope(position, Series(t, np.random.default_rng(1).normal(size=2000))) is None


def test_longest_run():
    assert longest_run(np.array([True, False, True, True])) == (2, 2)
    assert longest_run(np.zeros(3, dtype=bool)) == (0, 0)


@pytest.mark.parametrize(("frame", "told"), [("own", False), ("world", True), ("straight", False)])
def test_velocities_of_a_base_in_the_frame_of_the_world_are_told(
    write_table: Callable, frame: str, told: bool
):
    """A base that drives a circle at 0.5 m/s, and one that drives straight on, of which nothing can be said."""
    t = np.arange(1000) / 50
    rate = 0.0 if frame == "straight" else 0.6
    yaw = rate * t
    vx, vy = 0.5 * np.cos(yaw), 0.5 * np.sin(yaw)
    x, y = (np.cumsum(v) / 50 for v in (vx, vy))
    own = frame == "own"
    columns = {"base__x": x, "base__y": y, "base__yaw": np.angle(np.exp(1j * yaw))}
    columns |= {"base__vx": np.full(1000, 0.5) if own else vx, "base__vy": np.zeros(1000) if own else vy}
    units = {"x": "m", "y": "m", "yaw": "rad", "vx": "m/s", "vy": "m/s"}
    channels = tuple(ChannelSpec(f"base/{name}", unit, "state") for name, unit in units.items())
    spec = RecordingSpec("walker", channels, (), 50.0)
    t[500] = t[499]  # a stamp that repeats is no reason to look away
    found = [f for f in doctor(write_table(time=t, **columns), spec) if f.check == "frame"]
    assert [("base/vx and base/vy" in f.where, "the world's frame" in f.told) for f in found] == [
        (True, True)
    ] * told


def commanded_at(seconds: np.ndarray, every: int = 1) -> Columns:
    """Columns of a servo with a target for each `every`th stamp, which the rows between repeat."""
    told = np.sin(2 * np.pi * 0.3 * seconds[np.arange(len(seconds)) // every * every])
    return {"time": seconds, "arm__position": np.sin(2 * seconds), "arm__target": told}


@pytest.mark.parametrize(
    ("control", "rows", "every", "told"),
    [(50.0, 100, 1, "100 Hz, control_rate is 50 Hz: 50 %"), (100.0, 500, 1, "500 Hz"), (50.0, 500, 10, "")],
)
def test_commands_that_control_would_drop_are_told(
    control: float, rows: int, every: int, told: str, write_table: Callable, servo_spec: RecordingSpec
):
    channels = tuple(c for c in servo_spec.channels if c.name in ("arm/position", "arm/target"))
    spec = replace(servo_spec, channels=channels, settings=(), rate=control)
    found = [f for f in doctor(write_table(**commanded_at(np.arange(6 * rows) / rows, every)), spec)]
    said = [f.told for f in found if "commands come at" in f.told]
    assert len(said) == (1 if told else 0) and told in "".join(said)


@pytest.mark.parametrize("per_second", [1000, 700])
def test_commands_that_lie_between_those_that_control_takes_are_no_warning(
    per_second: int, write_table: Callable, servo_spec: RecordingSpec
):
    """A robot that is drafted from a log above 500 Hz takes one in two; each log of it was warned of."""
    channels = tuple(c for c in servo_spec.channels if c.name in ("arm/position", "arm/target"))
    spec = replace(servo_spec, channels=channels, settings=(), rate=per_second / 2)
    columns, rng = commanded_at(np.arange(3000) / per_second), np.random.default_rng(0)
    smooth = columns["arm__target"]
    cases = {
        "info": (smooth, np.where(smooth > 0.5, 1.0, smooth), smooth + 0.005 * rng.standard_normal(3000)),
        "warning": (rng.uniform(-0.2, 0.2, 3000), smooth + 0.1 * rng.standard_normal(3000)),
    }
    for severity, targets in cases.items():
        for target in targets:
            found = doctor(write_table(**columns | {"arm__target": target}), spec)
            (told,) = [f for f in found if "commands come at" in f.message]
            assert told.severity == severity and "50 % of them are dropped" in told.message
            assert f"set control_rate = {per_second} in robot.toml" in told.do


@pytest.mark.parametrize("late", [2, 5])  # a single stale stamp is dropped
def test_commands_of_a_clock_that_runs_back_at_first_are_not_said_to_lose_nothing(
    write_table: Callable, servo_spec: RecordingSpec, late: int
):
    channels = tuple(c for c in servo_spec.channels if c.name in ("arm/position", "arm/target"))
    columns = commanded_at(np.arange(4000) / 1000.0)
    columns["time"][:late] = 100.0 + np.arange(late) / 1000.0
    found = doctor(write_table(**columns), replace(servo_spec, channels=channels, settings=()))
    assert any(f.check == "clock" for f in found)
    assert not any("lie between those that are taken" in f.message for f in found)


def test_commands_with_scattered_stamps_are_not_said_to_be_dropped(
    write_table: Callable, servo_spec: RecordingSpec
):
    """They come in pairs, a bus's way, or at any time within their step: 100 a second on the whole."""
    channels = tuple(c for c in servo_spec.channels if c.name in ("arm/position", "arm/target"))
    spec = replace(servo_spec, channels=channels, settings=())
    even, rng = np.arange(600) / 100, np.random.default_rng(0)
    for seconds in (even - np.arange(600) % 2 * 0.009, even + rng.uniform(0, 0.009, 600)):
        found = doctor(write_table(**commanded_at(seconds)), spec)
        assert not any("commands come at" in f.told for f in found)


def computed(values: np.ndarray, error: float) -> Series:
    """A rate that was computed from positions at 50 Hz, off by `error`."""
    return replace(Series(np.arange(len(values)) / 50.0, values), error=error)


@pytest.mark.parametrize(("lost", "severity"), [(10, "info"), (200, "warning")])
def test_rates_that_are_not_known_are_told_and_warned_of_where_they_are_many(lost: int, severity: str):
    values = np.sin(np.arange(500) / 10.0)
    values[100 : 100 + lost] = np.nan
    (found,) = check_numbers(computed(values, 0.001), "log.csv, arm/velocity")
    assert (found.severity, found.check) == (severity, "rate")
    assert f"{lost} of 500 rates are not known" in found.told
    assert ("log faster" in found.told) == (severity == "warning")


@pytest.mark.parametrize(("error", "told"), [(0.3, 0), (0.4, 1)])
def test_rates_are_warned_of_that_are_off_by_half_their_size(error: float, told: int):
    found = list(check_numbers(computed(np.sin(np.arange(500) / 10.0), error), "log.csv, arm/velocity"))
    assert [f.severity for f in found] == ["warning"] * told
    assert all("its rates of 0.71 (rms) are off by 0.4 (1 sigma)" in f.told for f in found)


def test_a_rate_that_was_computed_is_not_compared_with_its_own_position():
    time = np.arange(1000) / 50.0
    position, twice = Series(time, np.sin(time)), 2.0 * np.cos(time)
    for error, told in ((None, 1), (0.001, 0)):
        velocity = replace(Series(time, twice), error=error)
        episode = RawEpisode("1", "log.csv", {"arm/position": position, "arm/velocity": velocity})
        assert len(list(velocities(episode, "log.csv"))) == told


def test_a_velocity_a_thousand_times_too_large_may_be_a_clock_of_milliseconds():
    time = np.arange(1000) / 50.0
    for factor, said in ((1000.0, True), (180.0 / np.pi, False)):
        channels = {
            "arm/position": Series(time, np.sin(time)),
            "arm/velocity": Series(time, factor * np.cos(time)),
        }
        (found,) = velocities(RawEpisode("1", "log.csv", channels), "log.csv")
        assert (
            ("in thousandths, or the clock is" in found.message) == ('time_unit = "ms"' in found.do) == said
        )


@pytest.mark.parametrize(
    ("order", "do"),
    [
        (np.arange(801)[::-1], "in reverse order: sort"),
        (np.r_[:400, 401, 400, 402:801], "if rows are out of order, sort"),
        (np.r_[:400, 398:799], "if the clock was set back, split"),
        (np.r_[500:801, :500], 'mend it, or split there with by = "gaps"'),
    ],
)
def test_rows_in_a_wrong_order_are_to_be_sorted_and_runs_one_after_another_split(
    order: np.ndarray, do: str, write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    rows = {name: column[order] for name, column in swing.items()}
    (found,) = [f for f in doctor(write_table(**rows), servo_spec) if "runs back" in f.message]
    assert do in found.do


def test_a_log_of_a_few_steps_is_refused_and_a_short_episode_beside_longer_ones_is_told(
    tmp_path: Path, write_table: Callable, swing: Columns, servo_spec: RecordingSpec
):
    short = {name: column[:6] for name, column in swing.items()}
    with pytest.raises(LogError, match="lasts 0.0.*less than 10 steps.*record longer"):
        read_recording(write_table("short.csv", **short), servo_spec)
    (tmp_path / "again").mkdir()
    both = [write_table("log.csv", **short), write_table("again/log.csv", **swing)]
    for logs in (both, both[::-1]):  # of one name
        (told,) = [f for f in doctor(logs, servo_spec) if f.check == "short"]
        assert told.severity == "warning" and told.where == "log.csv, episode log"
