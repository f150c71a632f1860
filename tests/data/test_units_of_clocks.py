"""The unit in which a table's clock counts: what states it, and what is said where nothing does."""

from collections.abc import Callable

import numpy as np
import pytest

from dynreg.data.ingest import doctor, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.schema import ChannelSpec, RecordingSpec

SPEC = RecordingSpec("one", (ChannelSpec("q", "rad", "state"),), (), 100.0)
ROWS = np.arange(300)


@pytest.mark.parametrize("step", [1, 2])
def test_fast_milliseconds_without_a_word_are_asked_about(step: int, write_table: Callable):
    """They may be a slow log as well, which is read as it is; to split it at each row would leave nothing."""
    path = write_table(time=ROWS * step, q=np.sin(ROWS / 50))
    (found,) = doctor(path)
    assert (found.severity, found.check) == ("warning", "gap")
    assert f"usually {step} s" in found.message and 'time_unit = "ms" under [map]' in found.message
    assert "by = " not in found.message
    assert read_recording(path, SPEC).episodes[0].duration == pytest.approx(299 * step)
    patient = parse_map(f'[channels.q]\nsource = "q"\n[episodes]\ngap = {step + 1}\n')
    assert not [f for f in doctor(path, SPEC, patient) if f.check == "gap"]


def test_a_step_that_two_units_explain_names_both(write_table: Callable):
    (found,) = doctor(write_table(time=ROWS * 100, q=np.sin(ROWS / 50)))
    assert "milliseconds (10 Hz) or microseconds (10000 Hz)" in found.message
    assert found.message.endswith('set time_unit = "ms" or "us" under [map]')


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
