"""Odd but plausible logs are read but for what is odd in them, which is told; or refused with one line."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from odd_logs import ALL, Odd

from dynreg.data.ingest import doctor, read_log, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.readers import ReadOptions
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.errors import DynregError, LogError

MAP = parse_map('[channels."q"]\nsource = "/arm.q"')
SPEC = RecordingSpec("one", (ChannelSpec("q", "rad", "state"),), (), 100.0)


@pytest.mark.parametrize("odd", ALL, ids=lambda odd: odd.title)
def test_an_odd_log_is_read_but_for_what_is_odd(odd: Odd, tmp_path: Path) -> None:
    path = tmp_path / odd.name
    odd.write(path)
    if odd.refused is not None:
        with pytest.raises(LogError, match=odd.refused):
            read_log(path, odd.options)
        return
    log = read_log(path, odd.options)
    series = log.sources[odd.source]
    np.testing.assert_array_equal(series.values, np.array(odd.values, dtype=float))
    np.testing.assert_allclose(series.time, np.array(odd.time, dtype=float)[: len(series)], rtol=0, atol=1e-9)
    told = [str(finding) for finding in log.findings]
    assert any(odd.told in line for line in told) if odd.told else told == []


@pytest.mark.parametrize("odd", ALL, ids=lambda odd: odd.title)
def test_no_odd_log_is_a_bug_further_on(odd: Odd, tmp_path: Path) -> None:
    odd.write(tmp_path / odd.name)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert all(finding.message for finding in doctor(tmp_path / odd.name))
        for log_map in (None, MAP):
            assert all(finding.message for finding in doctor(tmp_path / odd.name, SPEC, log_map))
            try:
                recording = read_recording(tmp_path / odd.name, SPEC, log_map)
            except DynregError:
                continue
            assert recording.names == ("q",)


def test_an_empty_stamp_among_whole_nanoseconds_keeps_the_digits_of_the_others(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("time,q\n1700000000000000001,0\n,1\n1700000000000000004,2\n")
    time = read_log(tmp_path / "x.csv", ReadOptions(time_unit="ns")).sources["q"].time
    np.testing.assert_allclose(time, [0, np.nan, 3e-9], rtol=1e-12)
