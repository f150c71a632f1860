"""Whatever numbers a map and a log hold, an ingest ends with a recording or one line, and soon."""

import itertools
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.derivative import derivative
from dynreg.data.ingest import doctor, read_recording
from dynreg.data.maps import parse_map
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import Series
from dynreg.errors import DynregError, LogError, MapError

SPEC = RecordingSpec(
    "one",
    (ChannelSpec("a/position", "rad", "state"), ChannelSpec("a/velocity", "rad/s", "state")),
    ("kp",),
    100.0,
)
T = np.arange(60) * 0.01
CLOCKS = {
    "even": T,
    "a leap": np.append(T[:-1], 1e12),
    "a first pause": np.array([0, 1e-9, 2e-9, 1e9]),
    "tiny": T * 1e-300,
    "immense": T * 1e300,
    "one row": T[:1],
    "back": T[::-1],
}
SIZES = {"ordinary": 1.0, "near the largest double": 1e308}
LINES = {
    "map": ('time_unit = "ns"',),
    "position": ("scale = 1e308", "offset = -1e308", "delay = 1e308", "unwrap = true"),
    "velocity": ("filter_hz = 20.0", "filter_hz = 1e-300", "filter_hz = 1e300", "delay = 1e-300"),
    "setting": ("scale = 1e308",),
    "episodes": (
        'by = "gaps"\ngap = 0.005',
        'by = "column"\ncolumn = "q"',
        'name = "{0}"',
        'name = "{stem:f}"',
    ),
}


def of_map(part: str = "", line: str = "") -> str:
    """A map with one line more in one of its parts."""
    more = {name: line if name == part else "" for name in LINES}
    return (
        f'[map]\n{more["map"]}\n[channels."a/position"]\nsource = "q"\n{more["position"]}\n'
        f'[channels."a/velocity"]\nderivative_of = "a/position"\n{more["velocity"]}\n'
        f"[settings.kp]\nvalue = 1.0\n{more['setting']}\n[episodes]\n{more['episodes']}\n"
    )


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("size", SIZES)
def test_an_ingest_ends_with_a_recording_or_one_line(clock: str, size: str, tmp_path: Path) -> None:
    values = SIZES[size] * np.sin(CLOCKS[clock] % 7 * 3)
    rows = zip(CLOCKS[clock].tolist(), values.tolist(), strict=True)
    (tmp_path / "run.csv").write_text("time,q\n" + "".join(f"{t!r},{q!r}\n" for t, q in rows))
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for part, line in (("", ""), *((part, line) for part, lines in LINES.items() for line in lines)):
            log_map = parse_map(of_map(part, line))
            assert all(finding.message for finding in doctor(tmp_path / "run.csv", SPEC, log_map))
            try:
                read_recording(tmp_path / "run.csv", SPEC, log_map)
            except DynregError as error:
                assert "\n" not in str(error)
    assert time.process_time() - began < 20


@pytest.mark.parametrize(
    ("part", "line"),
    [
        *itertools.product(("position",), ("scale = inf", "offset = nan", "delay = -inf")),
        ("velocity", "filter_hz = inf"),
        ("episodes", 'name = "{kp:100000000}"'),
        ("episodes", 'name = "{stem:{kp}}"'),
    ],
)
def test_what_no_map_means_is_refused(part: str, line: str) -> None:
    with pytest.raises(MapError, match="finite|plain names"):
        parse_map(of_map(part, line))


def test_a_rate_over_a_leap_of_the_clock_is_not_filled_in() -> None:
    series = Series(np.array([0, 1e-9, 2e-9, 1e9]), np.arange(4.0))
    with pytest.raises(LogError, match="spread over 1e"):
        derivative(series, 20.0)


def test_many_episodes_are_split_in_one_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = (f"{k * 0.01:.2f},{k % 7},{k // 2}\n" for k in range(2000))
    (tmp_path / "run.csv").write_text("time,q,e\n" + "".join(rows))
    spec = RecordingSpec("one", SPEC.channels[:1], (), None)
    log_map = parse_map('[channels."a/position"]\nsource = "q"\n[episodes]\nby = "column"\ncolumn = "e"')
    recording = read_recording(tmp_path / "run.csv", spec, log_map)
    assert [e.name for e in recording.episodes] == [str(k) for k in range(1000)]
    assert recording.episodes[-1].values.ravel().tolist() == [1998 % 7, 1999 % 7]
    monkeypatch.setenv("DYNREG_MAX_EPISODES", "999")
    for text in ('by = "column"\ncolumn = "e"', 'by = "gaps"\ngap = 0.005'):
        with pytest.raises(LogError, match="DYNREG_MAX_EPISODES"):
            read_recording(
                tmp_path / "run.csv",
                spec,
                parse_map(f'[channels."a/position"]\nsource = "q"\n[episodes]\n{text}'),
            )
