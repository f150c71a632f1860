"""The unit in which a table's clock counts: what states it, and what is said where nothing does."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.checks import clock
from dynreg.data.drafting import draft_map
from dynreg.data.ingest import doctor, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog, Series
from dynreg.draft.heard import heard, require_clocks
from dynreg.errors import LogError, MapError

SPEC = RecordingSpec("one", (ChannelSpec("q", "rad", "state"),), (), 100.0)
ROWS = np.arange(300)
MANY = np.arange(3000)


@pytest.mark.parametrize("step", [1, 2])
def test_fast_milliseconds_without_a_word_are_asked_about(step: int, write_table: Callable):
    """They may be a slow log as well, which is read as it is; to split it at each row would leave nothing."""
    path = write_table(time=ROWS * step, q=np.sin(ROWS / 50))
    (found,) = doctor(path)
    assert (found.severity, found.check) == ("warning", "gap")
    assert f"usually {step} s" in found.told and 'time_unit = "ms" under [map]' in found.told
    assert "by = " not in found.told
    assert read_recording(path, SPEC).episodes[0].duration == pytest.approx(299 * step)
    patient = parse_map(f'[channels.q]\nsource = "q"\n[episodes]\ngap = {step + 1}\n')
    assert not [f for f in doctor(path, SPEC, patient) if f.check == "gap"]


def test_a_step_that_two_units_explain_names_both(write_table: Callable):
    (found,) = doctor(write_table(time=ROWS * 100, q=np.sin(ROWS / 50)))
    assert "milliseconds (10 Hz) or microseconds (10000 Hz)" in found.told
    assert found.told.endswith('set time_unit = "ms" or "us" under [map]')


@pytest.mark.parametrize(
    ("name", "told", "second"),
    [
        ("time_ms", None, 1e3),
        ("robot_clock_us", None, 1e6),
        ("Time [ns]", None, 1e9),
        ("Time [µs]", None, 1e6),
        ("Robot clock (msec)", None, 1e3),
        ("ticks", None, 1.0),
        ("time_ms", "s", 1.0),
        ("ticks", "ms", 1e3),
    ],
)
def test_a_map_that_names_the_clock_need_not_say_what_its_name_states(
    name: str, told: str | None, second: float, write_table: Callable
):
    path = write_table(**{name: ROWS * 1000, "q": np.sin(ROWS / 50)})
    unit = "" if told is None else f'time_unit = "{told}"\n'
    log_map = parse_map(f'[map]\ntime = "{name}"\n{unit}[channels.q]\nsource = "q"\n')
    time = read_log(path, ReadOptions(log_map.map.time, log_map.map.time_unit)).sources["q"].time
    np.testing.assert_allclose(time, ROWS * 1000 / second)


@pytest.mark.parametrize(
    ("name", "step", "rate", "says", "unit"),
    [
        ("time_ms", 0.002, 500_000, "milliseconds", "s"),
        ("Time [ms]", 0.1, 10_000, "milliseconds", "s"),
        ("time_us", 2, 500_000, "microseconds", "ms"),
        ("elapsed_ns", 5000, 200_000, "nanoseconds", "us"),
    ],
)
def test_a_name_that_says_a_unit_in_which_no_robot_is_logged_is_doubted(
    name: str, step: float, rate: int, says: str, unit: str, write_table: Callable
):
    path = write_table(**{name: ROWS * step, "q": np.sin(ROWS / 50)})
    (found,) = doctor(path)
    assert found.severity == "warning" and f"the name {name!r} says {says}" in found.told
    assert f"({rate} Hz)" in found.told and f'set time_unit = "{unit}" under [map]' in found.told
    log_map = parse_map(f'[map]\ntime_unit = "{unit}"\n[channels.q]\nsource = "q"\n')
    assert not [f for f in doctor(path, SPEC, log_map) if f.check in ("clock", "rate")]
    assert f'time_unit = "{unit}"' in draft_map(read_log(path)).text


@pytest.mark.parametrize(
    ("name", "step"), [("time_s", 1.0), ("time_s", 60.0), ("time_ms", 1), ("time_us", 100)]
)
def test_a_name_that_says_a_unit_in_which_a_robot_may_be_logged_is_believed(
    name: str, step: float, write_table: Callable
):
    found = doctor(write_table(**{name: ROWS * step, "q": np.sin(ROWS / 50)}))
    assert not [f for f in found if "time_unit" in f.told or f.check == "clock"], found


def test_a_clock_in_days_is_told_to_be_one(write_table: Callable):
    (found,) = doctor(write_table(time=739_000 + ROWS * 0.01 / 86400, q=np.sin(ROWS / 50)))
    assert "the clock looks like days; multiply it by 86400" in found.told
    (fast,) = doctor(write_table(time=ROWS * 1e-5, q=np.sin(ROWS / 50)))
    assert '(100000 Hz): no robot is logged so; set time_unit = "s" under [map] if it is so' in fast.told


DRAFTED = {  # steps of a clock that says no unit: the line of its unit in a drafted map
    10**7: 'time_unit = "ns"    # by its steps: check it',
    10: 'time_unit = "ms"    # by its steps: check it',
    0.01: 'time_unit = "s"',
    100: '# time_unit = "ms"    # or "us": its steps do not tell which',
    2: '# time_unit = "ms"    # or "s": its steps do not tell which',
}


@pytest.mark.parametrize("step", DRAFTED)
def test_a_drafted_map_says_the_unit_that_is_said_of_the_clock(step: float, write_table: Callable):
    log = read_log(write_table(time=ROWS * step, q=np.sin(ROWS / 50)))
    draft = draft_map(log, SPEC)
    assert DRAFTED[step] in draft.text.splitlines()
    known = parse_map(draft.text).map.time_unit
    assert known == (None if DRAFTED[step].startswith("#") else DRAFTED[step].split('"')[1])


def test_a_map_drafted_from_a_slow_log_of_which_the_unit_is_known_asks_no_more(write_table: Callable):
    path = write_table(time_s=ROWS * 1.0, q=np.sin(ROWS / 50))
    draft = draft_map(read_log(path), SPEC)
    spec = RecordingSpec("one", SPEC.channels, (), 1.0)
    assert "gap = 3.0    # its rows come every 1 s" in draft.text
    assert not [f for f in doctor(path, spec, draft.log_map) if f.check in ("clock", "gap", "rate")]


REPEATED = {  # stamps and values of a log in which stamps repeat: what is said
    "coarse": (
        np.round(ROWS / 125, 2),
        np.sin(ROWS / 50),
        "written to 0.01 s, and rows come about every 0.008 s",
    ),
    "95 Hz": (np.floor(MANY / 9.5) / 10, np.sin(MANY / 50), "number of the row times 0.010526;"),
    "seconds": (ROWS // 20, np.sin(ROWS / 50), "written to 1 s, and rows come about every 0.05"),
    "each row twice": (ROWS // 2 * 0.01, np.sin(ROWS // 2 / 50), "150 stamps repeat the one before; of rows"),
    "one row twice": (
        np.maximum(ROWS - (ROWS > 9), 0) * 0.01,
        np.sin(ROWS / 50),
        "1 stamps repeat the one before; of",
    ),
    "a stop": (np.minimum(ROWS, 200) * 0.01, np.sin(ROWS / 50), "the clock stands still at 2.000000 s"),
}


@pytest.mark.parametrize("case", REPEATED)
def test_stamps_that_repeat_are_told_for_what_they_are(case: str, write_table: Callable):
    time, values, said = REPEATED[case]
    found = [f for f in doctor(write_table(time=time, q=values)) if f.check == "clock"]
    assert len(found) == 1 and said in f"{found[0].told};", found
    assert found[0].severity == ("error" if case in ("seconds", "a stop") else "warning")


def test_of_many_signals_of_one_clock_it_is_looked_at_once(write_table: Callable, monkeypatch):
    log = read_log(write_table(time=ROWS * 0.01, **{f"q{i}": np.sin(ROWS + i) for i in range(50)}))
    apart = RawLog(
        log.path, {n: Series(s.time.copy(), s.values) for n, s in log.sources.items()}, log.metadata
    )
    seen = []
    monkeypatch.setattr(clock, "usual_step", lambda time: seen.append(len(time)) or 0.01)
    for one in (log, apart):
        assert len(clock.quickest(one)) == len(ROWS)
    assert len(seen) == 2


def test_a_clock_in_a_unit_that_is_not_read_is_not_drafted_as_settled(write_table: Callable):
    """The map has what is said of it as a comment, and a robot is not drafted from it."""
    for time, said in (
        (739_000 + ROWS * 0.01 / 86400, "the clock looks like days; multiply it by 86400 and call it time_s"),
        (ROWS * 1e-5, "no robot is logged so; set time_unit"),
    ):
        draft = draft_map(read_log(write_table(time=time, q=np.sin(ROWS / 50))), SPEC)
        (line,) = (line for line in draft.text.splitlines() if "time_unit =" in line)
        assert line.startswith('# time_unit = "s"    # ') and said in line
        assert parse_map(draft.text).map.time_unit is None
        with pytest.raises(LogError) as caught:
            require_clocks(heard(draft), draft.log)
        assert "[map]" not in caught.value.do
        assert ("multiply it by 86400" in caught.value.do) == ("86400" in said)


@pytest.mark.parametrize("whole, rest", [("secs", "nsecs"), ("header.stamp.sec", "header.stamp.nanosec")])
def test_stamps_in_two_columns_are_to_be_added(whole: str, rest: str, write_table: Callable):
    """Whole seconds alone are no clock, nor are their nanoseconds; another clock beside them counts."""
    columns = {whole: ROWS // 100, rest: ROWS % 100 * 10_000_000, "q": np.sin(ROWS / 50)}
    with pytest.raises(LogError) as caught:
        read_log(write_table(**columns))
    assert caught.value.do == f"add the two: {whole} + 1e-9 * {rest}, in a column called time"
    assert read_log(write_table(**columns, time=ROWS * 0.01)).counting.column == "time"


def test_a_clock_whose_unit_is_not_read_is_not_offered(write_table: Callable):
    path = write_table(time_min=ROWS * 0.01, q=np.sin(ROWS / 50))
    with pytest.raises(MapError) as caught:
        read_log(path, ReadOptions("stamp"))
    assert "is then the clock" not in str(caught.value)
    path = write_table(time_min=ROWS * 0.01, elapsed_s=ROWS * 0.6, q=np.sin(ROWS / 50))
    with pytest.raises(MapError, match="'elapsed_s' is then the clock"):
        read_log(path, ReadOptions("stamp"))


def test_coarse_stamps_are_told_before_the_filter_that_they_make_too_quick(
    write_table: Callable, tmp_path: Path
):
    """Of several logs the one that is so is named."""
    good = write_table(time=ROWS * 0.02, q=np.sin(ROWS / 50)).rename(tmp_path / "good.csv")
    bad = write_table(time=np.round(ROWS * 0.02, 1), q=np.sin(ROWS / 50)).rename(tmp_path / "bad.csv")
    spec = RecordingSpec("one", (*SPEC.channels, ChannelSpec("q/velocity", "rad/s", "state")), (), 50.0)
    log_map = parse_map(
        '[map]\n[channels.q]\nsource = "q"\nunit = "rad"\n'
        '[channels."q/velocity"]\nderivative_of = "q"\nfilter_hz = 10.0\n'
    )
    for logs in ([bad], [good, bad]):
        with pytest.raises(LogError) as caught:
            read_recording(logs, spec, log_map)
        assert caught.value.problem.startswith("bad.csv: ") and "written to 0.1 s" in caught.value.problem
        assert caught.value.do.startswith("write them with more digits")
        (found,) = doctor(logs, spec, log_map)
        assert (found.where, found.severity) == ("bad.csv", "error")
