"""Recordings come back from their files as they were."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynreg.data.ingest import read_recording
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.table import (
    from_table,
    map_for,
    read_parquet,
    to_table,
    write_csv,
    write_mcap,
    write_parquet,
)
from dynreg.errors import LogError

NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), min_size=1, max_size=8)
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    names = draw(
        st.lists(NAMES.filter(lambda n: n not in ("episode", "time")), min_size=1, max_size=3, unique=True)
    )
    episodes = []
    for name in draw(st.lists(NAMES, min_size=1, max_size=3, unique=True)):
        rows = draw(st.integers(1, 6))
        steps = draw(arrays(float, rows, elements=st.floats(1e-6, 10)))
        values = draw(arrays(float, (rows, len(names)), elements=NUMBERS))
        constants = draw(st.dictionaries(NAMES, st.floats(allow_nan=False, allow_infinity=False), max_size=2))
        episodes.append(Episode(name, np.cumsum(steps), values, constants))
    channels = tuple(Channel(name, draw(st.sampled_from(["rad", "N*m", "1"]))) for name in names)
    return Recording(channels, tuple(episodes), draw(st.booleans()), {"map": {"a": [1, None]}})


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(recordings())
def test_parquet_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, recording: Recording):
    path = tmp_path_factory.mktemp("r") / "r.parquet"
    write_parquet(recording, path)
    back = read_parquet(path)
    assert back.id == recording.id
    assert (back.measured, back.provenance) == (recording.measured, recording.provenance)
    for mine, theirs in zip(recording.episodes, back.episodes, strict=True):
        np.testing.assert_array_equal(mine.values, theirs.values)
    first = path.read_bytes()
    write_parquet(back, path)
    assert path.read_bytes() == first  # the same recording, the same bytes


@pytest.fixture
def spec() -> RecordingSpec:
    channels = (
        ChannelSpec("arm/position", "rad", "state"),
        ChannelSpec("supply", "V", "input", optional=True),
        ChannelSpec("arm/target", "rad", "action"),
    )
    return RecordingSpec("servo", channels, ("kp", "mass"), 100.0)


@pytest.fixture
def recording(spec: RecordingSpec) -> Recording:
    rng = np.random.default_rng(8)
    episodes = tuple(
        Episode(str(i), np.arange(50) / 100, rng.normal(size=(50, 3)), {"kp": 100.0 * (i + 1), "mass": 0.5})
        for i in range(3)
    )
    return Recording(tuple(Channel(c.name, c.unit) for c in spec.channels), episodes)


def same(a: Recording, b: Recording, atol: float) -> None:
    assert a.channels == b.channels
    assert [(e.name, e.settings) for e in a.episodes] == [(e.name, e.settings) for e in b.episodes]
    for mine, theirs in zip(a.episodes, b.episodes, strict=True):
        # clocks that all begin anew are written one after the other, and so they are read
        np.testing.assert_allclose(mine.time - mine.time[0], theirs.time - theirs.time[0], atol=1e-9)
        np.testing.assert_allclose(mine.values, theirs.values, rtol=0, atol=atol)


@pytest.mark.parametrize("write", [write_csv, write_parquet])
def test_tables_are_logs_that_need_no_map(write, recording: Recording, spec: RecordingSpec, tmp_path: Path):
    path = tmp_path / ("r" + {write_csv: ".csv", write_parquet: ".parquet"}[write])
    write(recording, path)
    same(recording, read_recording(path, spec), atol=1e-12)


def test_mcap_with_its_map(recording: Recording, spec: RecordingSpec, tmp_path: Path):
    write_mcap(recording, tmp_path / "r.mcap")
    # stamps are whole nanoseconds, so interpolation is off by at most the slope times 1 ns
    same(recording, read_recording(tmp_path / "r.mcap", spec, map_for(recording)), atol=1e-6)


@pytest.mark.parametrize("apart", [0.49, 0.4895], ids=["touch", "overlap"])
def test_episodes_that_touch_keep_all_their_rows_in_an_mcap_file(
    apart: float, recording: Recording, spec: RecordingSpec, tmp_path: Path
):
    """One begins where the one before it ends, or within the tolerance of a clock before that."""
    episodes = tuple(replace(e, time=e.time + k * apart) for k, e in enumerate(recording.episodes))
    touching = replace(recording, episodes=episodes)
    assert touching.begins() == pytest.approx([0.0, apart, 2 * apart])
    write_mcap(touching, tmp_path / "r.mcap")
    back = read_recording(tmp_path / "r.mcap", spec, map_for(touching))
    same(touching, back, atol=1e-6)
    assert back.begins() == pytest.approx([0.0, 0.5, 1.0], abs=1e-6)


def test_names_that_would_meet_in_an_mcap_file_stay_apart(tmp_path: Path):
    names = ("arm", "arm/value", "episode", "settings/kp", "episode_/value")
    spec = RecordingSpec("arm", tuple(ChannelSpec(name, "rad", "state") for name in names), ("kp",), 100.0)
    values = np.random.default_rng(9).normal(size=(50, len(names)))
    episodes = tuple(Episode(str(i), np.arange(50) / 100, values + i, {"kp": 100.0 + i}) for i in range(2))
    odd = Recording(tuple(Channel(name, "rad") for name in names), episodes)
    write_mcap(odd, tmp_path / "r.mcap")
    same(odd, read_recording(tmp_path / "r.mcap", spec, map_for(odd)), atol=1e-6)


def test_units_are_in_the_fields(recording: Recording):
    assert to_table(recording).schema.field("supply").metadata == {b"role": b"channel", b"unit": b"V"}


def test_other_tables_are_refused(recording: Recording, tmp_path: Path):
    table = to_table(recording)
    for bad in (table.replace_schema_metadata(None), table.slice(0, 10), table.drop_columns(["time"])):
        with pytest.raises(LogError, match="not a stored recording"):
            from_table(bad)
    pq.write_table(pa.table({"x": [1]}), tmp_path / "x.parquet")
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "x.parquet").read_bytes()[:20])
    for name in ("x.parquet", "cut.parquet", "none.parquet"):
        with pytest.raises(LogError):
            read_parquet(tmp_path / name)
