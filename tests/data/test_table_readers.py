"""Tables of every kind become the columns that were written."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat, savemat

from dynreg.data.drafting import draft_map
from dynreg.data.ingest import read_recording
from dynreg.data.maps import EpisodeMap
from dynreg.data.readers import ReadOptions, read_log
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.errors import LogError, MapError

T = np.arange(50) * 0.01
Q = np.sin(T)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_csv(delimiter: str, tmp_path: Path):
    lines = [delimiter.join(("# time", "q", "who"))]
    lines += [
        delimiter.join((repr(t), repr(q), "a")) for t, q in zip((T + 5).tolist(), Q.tolist(), strict=True)
    ]
    (tmp_path / "x.csv").write_text("\ufeff" + "\n".join(lines))
    log = read_log(tmp_path / "x.csv")
    np.testing.assert_array_equal(log.sources["q"].values, Q)
    np.testing.assert_allclose(log.sources["q"].time, T, atol=1e-12)
    assert log.metadata["start"] == 5.0
    assert set(log.labels["who"]) == {"a"}


def test_missing_cells_are_nan(tmp_path: Path):
    (tmp_path / "x.csv").write_text("t,q\n0,1\n1,\n2,nan\n3,4\n")
    values = read_log(tmp_path / "x.csv").sources["q"].values
    np.testing.assert_array_equal(values, [1, np.nan, np.nan, 4])


def test_whole_nanoseconds_lose_no_digit(tmp_path: Path):
    stamps = 1_700_000_000_000_000_001 + 2_000_000 * np.arange(5)
    pq.write_table(pa.table({"stamp": stamps, "q": np.ones(5)}), tmp_path / "x.parquet")
    log = read_log(tmp_path / "x.parquet", ReadOptions(time="stamp", time_unit="ns"))
    np.testing.assert_allclose(log.sources["q"].time, 0.002 * np.arange(5), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "second"),
    [
        *(("Time [s]", 1.0), ("time [ms]", 1e3), ("t (us)", 1e6), ("Timestamp[ns]", 1e9)),
        *(("Time [µs]", 1e6), ("Time (μs)", 1e6), ("time [sec]", 1.0), ("Time [msec]", 1e3), ("[msec]", 1e3)),
        *(("seconds", 1.0), ("elapsed_ms", 1e3), ("Elapsed Time (sec)", 1.0), ("timestampUs", 1e6)),
    ],
)
def test_a_clock_whose_unit_stands_in_brackets_needs_no_map(name: str, second: float, tmp_path: Path):
    rows = [f"{t * second:.0f},{q}" for t, q in zip(range(50), Q.tolist(), strict=True)]
    (tmp_path / "x.csv").write_text("\n".join([f"{name},q", *rows]))
    log = read_log(tmp_path / "x.csv")
    assert list(log.sources) == ["q"]
    np.testing.assert_allclose(log.sources["q"].time, np.arange(50.0))


@pytest.mark.parametrize(
    ("name", "second"),
    [("__time", 1.0), ("_time", 1.0), ("TIME", 1.0), ("Header.Stamp", 1.0), ("Time_ms", 1e3), ("%time", 1e9)],
)
def test_a_clock_as_other_tools_name_it_needs_no_map(name: str, second: float, tmp_path: Path):
    start = 1_718_900_000
    rows = [f"{q},{(start + t) * second:.0f},20" for t, q in zip(range(50), Q.tolist(), strict=True)]
    (tmp_path / "x.csv").write_text("\n".join([f"q,{name},T", *rows]))
    log = read_log(tmp_path / "x.csv")
    assert set(log.sources) == {"q", "T"} and log.metadata["start"] == pytest.approx(start)
    np.testing.assert_allclose(log.sources["q"].time, np.arange(50.0))


def test_parquet_lists_flags_and_units(tmp_path: Path):
    fields = [
        pa.field("time", pa.float64()),
        pa.field("state", pa.list_(pa.float32())),
        pa.field("on", pa.bool_()),
        pa.field("q", pa.float64(), metadata={"unit": "deg"}),
    ]
    rows = pa.table([T, [[k, -k] for k in range(50)], [k % 2 == 0 for k in range(50)], Q], pa.schema(fields))
    pq.write_table(rows, tmp_path / "x.parquet")
    log = read_log(tmp_path / "x.parquet")
    np.testing.assert_array_equal(log.sources["state[1]"].values, -np.arange(50))
    assert log.sources["on"].values.sum() == 25
    assert log.sources["q"].unit == "deg"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("q,v\n1,2\n", "no column that looks like time"),
        ("time,q\n", "has no rows"),
        ("Time [min],q\n1,2\n2,3\n", "'Time \\[min\\]' counts in min, which is not read"),
        ("time,q\n1,2\n1,2,3\n", "table"),
    ],
)
def test_bad_csv(text: str, message: str, tmp_path: Path):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(LogError, match=message):
        read_log(tmp_path / "x.csv")


def test_cut_parquet(tmp_path: Path):
    pq.write_table(pa.table({"time": T}), tmp_path / "x.parquet")
    (tmp_path / "y.parquet").write_bytes((tmp_path / "x.parquet").read_bytes()[:-30])
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "y.parquet")


def test_matlab_vectors_and_scalars(tmp_path: Path):
    savemat(
        tmp_path / "x.mat", {"t": T[:, None], "q": Q[None, :], "gain": 3.5, "other": np.ones(7), "name": "x"}
    )
    log = read_log(tmp_path / "x.mat")
    assert set(log.sources) == {"q"} and log.metadata["gain"] == 3.5
    np.testing.assert_array_equal(log.sources["q"].values, Q)
    assert [f.check for f in log.findings] == ["left_out"]


@pytest.mark.parametrize("compress", [False, True])
def test_matlab_reader_agrees_with_scipy(compress: bool, tmp_path: Path):
    kinds = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
    rng = np.random.default_rng(2)
    variables: dict = {f"v_{k}": (100 * rng.random(50)).astype(k) for k in kinds}
    variables |= {
        "t": T,
        "flag": T > 0.2,
        "one": 1.0,
        "matrix": np.ones((3, 4)),
        "cell": np.array([[1], "a"], object),
    }
    savemat(tmp_path / "x.mat", variables | {"struct": {"a": 1}}, do_compression=compress)
    log = read_log(tmp_path / "x.mat")
    assert set(log.sources) == {*(f"v_{k}" for k in kinds), "flag"}
    oracle = loadmat(tmp_path / "x.mat")
    for name, series in log.sources.items():
        np.testing.assert_array_equal(series.values, oracle[name].ravel().astype(float), err_msg=name)


def test_damaged_matlab_files_are_errors_and_never_crash(tmp_path: Path):
    savemat(tmp_path / "x.mat", {"t": T, "q": Q})
    whole, rng = (tmp_path / "x.mat").read_bytes(), np.random.default_rng(0)
    for _ in range(200):
        data = bytearray(whole[: rng.integers(10, len(whole) + 1)])
        for at in rng.integers(10, max(len(data), 11), 8) % len(data):
            data[at] = rng.integers(256)
        (tmp_path / "y.mat").write_bytes(data)
        with contextlib.suppress(LogError):
            read_log(tmp_path / "y.mat")


def test_matlab_7_3_says_how_to_save(tmp_path: Path):
    (tmp_path / "x.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    with pytest.raises(LogError, match="-v7"):
        read_log(tmp_path / "x.mat")


def test_bench_json_with_signed_duty(tmp_path: Path):
    loads = [0, 885, 65536 - 885]
    entries = [{"timestamp": 0.01 * i, "position": 0.1 * i, "load": v} for i, v in enumerate(loads)]
    (tmp_path / "x.json").write_text(json.dumps({"kp": 200, "trajectory": "sin", "entries": entries}))
    log = read_log(tmp_path / "x.json")
    np.testing.assert_array_equal(log.sources["duty"].values, [0, 1, -1])
    assert log.metadata["kp"] == 200 and log.metadata["trajectory"] == "sin"


@pytest.mark.parametrize("text", ["{", "[]", '{"entries": 3}', "[" * 100_000])
def test_other_json(text: str, tmp_path: Path):
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(LogError):
        read_log(tmp_path / "x.json")


def test_lerobot_dataset(tmp_path: Path):
    (tmp_path / "meta").mkdir()
    (tmp_path / "data" / "chunk-000").mkdir(parents=True)
    features = {"observation.state": {"dtype": "float32", "names": ["pan.pos", "lift.pos"]}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"fps": 30, "features": features}))
    for episode in range(2):
        rows = {
            "timestamp": np.arange(4) / 30,
            "episode_index": np.full(4, episode),
            "observation.state": [[k, 10 * episode + k] for k in range(4)],
        }
        pq.write_table(pa.table(rows), tmp_path / "data" / "chunk-000" / f"episode_{episode:06d}.parquet")
    log = read_log(tmp_path)
    np.testing.assert_array_equal(
        log.sources["observation.state[lift.pos]"].values, [0, 1, 2, 3, 10, 11, 12, 13]
    )
    assert log.metadata["fps"] == 30


def test_a_lerobot_dataset_falls_into_its_episodes_without_being_told(tmp_path: Path):
    """Its stamps start anew in each: neither is the clock said to run back. A map can still say otherwise."""
    from dynreg.data.ingest import examine, read_recording
    from dynreg.data.maps import LogMap
    from dynreg.data.schema import ChannelSpec, RecordingSpec

    (tmp_path / "meta").mkdir()
    (tmp_path / "data").mkdir()
    features = {"observation.state": {"dtype": "float32", "names": ["pan.pos"]}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"fps": 30, "features": features}))
    stamps, numbers = np.tile(np.arange(40) / 30, 2), np.repeat([0, 1], 40)
    rows = {
        "timestamp": stamps,
        "episode_index": numbers,
        "observation.state": [[float(k)] for k in range(80)],
    }
    pq.write_table(pa.table(rows), tmp_path / "data" / "all.parquet")
    assert not [f for f in examine(tmp_path)[1] if f.severity == "error"]
    spec = RecordingSpec("arm", (ChannelSpec("pan/position", "rad", "state"),), (), 30.0)
    channels = {"pan/position": {"source": "observation.state[pan.pos]"}}
    recording = read_recording(tmp_path, spec, LogMap.model_validate({"channels": channels}))
    assert [len(e.time) for e in recording.episodes] == [40, 40]
    whole = LogMap.model_validate({"channels": channels, "episodes": {"by": "file"}})
    with pytest.raises(LogError, match="runs back"):
        read_recording(tmp_path, spec, whole)


def test_npz_with_named_arrays(tmp_path: Path):
    """Vectors, columns of matrices by number and by name, scalars as settings; an array of another length is told."""
    rng = np.random.default_rng(0)
    q, tau = rng.normal(size=(50, 2)), rng.normal(size=50).astype(">f4")
    np.savez_compressed(
        tmp_path / "x.npz",
        time=T,
        q=q,
        dq=np.asfortranarray(q).T,
        tau=tau,
        joint_names=np.array(["hip", "knee"]),
        kp=np.array(20.0),
        other=np.zeros(7),
        cube=np.zeros((50, 2, 2)),
    )
    log = read_log(tmp_path / "x.npz")
    assert set(log.sources) == {f"{n}[{i}]" for n in ("q", "dq") for i in (0, 1, "hip", "knee")} | {"tau"}
    np.testing.assert_array_equal(log.sources["q[knee]"].values, q[:, 1])
    np.testing.assert_array_equal(log.sources["dq[hip]"].values, q[:, 0])
    np.testing.assert_array_equal(log.sources["tau"].values, tau.astype(float))
    assert log.metadata["kp"] == 20.0
    assert [f.where.split(", ")[1] for f in log.findings] == ["other", "cube"]


@pytest.mark.parametrize("wanted", [{"q[knee]"}, {"q[1]"}, {"q[hip]", "dq[2]"}])
def test_npz_gives_the_columns_that_are_asked_for(wanted: set[str], tmp_path: Path):
    """By name and by number, also where those of one array are not all wanted."""
    q = np.random.default_rng(0).normal(size=(50, 3))
    np.savez(tmp_path / "x.npz", time=T, q=q, dq=-q, joint_names=np.array(["hip", "knee", "ankle"]))
    log = read_log(tmp_path / "x.npz", ReadOptions(sources=frozenset(wanted)))
    assert set(log.sources) == wanted
    columns = {"q[knee]": q[:, 1], "q[1]": q[:, 1], "q[hip]": q[:, 0], "dq[2]": -q[:, 2]}
    for name in wanted:
        np.testing.assert_array_equal(log.sources[name].values, columns[name])


def test_a_map_drafted_from_an_npz_reads_it(tmp_path: Path):
    rng = np.random.default_rng(0)
    arrays = {key: rng.normal(size=(50, 3)).cumsum(axis=0) for key in ("pos", "cmd")}
    np.savez(tmp_path / "x.npz", time=T, **arrays, joint_names=np.array(["hip", "knee", "ankle"]))
    spec = RecordingSpec("leg", (ChannelSpec("knee/position", "rad", "state"),), (), None)
    drafted = draft_map(read_log(tmp_path / "x.npz"), spec)
    assert drafted.sources["knee/position"].keys["source"] == "pos[knee]"
    (episode,) = read_recording([tmp_path / "x.npz"], spec, drafted.log_map).episodes
    assert np.abs(episode.values[:, 0]).max() > 0


SLOW = np.arange(80) * 0.006 - 0.1


def write_arrays(path: Path, **arrays: np.ndarray) -> Path:
    savemat(path, arrays) if path.suffix == ".mat" else np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("name", "second"), [("cmd_time", 1.0), ("t_cmd", 1.0), ("cmdTimestamps", 1.0), ("cmd_time_ms", 1e3)]
)
def test_arrays_on_a_clock_of_their_own(suffix: str, name: str, second: float, tmp_path: Path):
    """Commands that begin before the states: both are told from the first stamp of the log."""
    told = np.random.default_rng(0).normal(size=(80, 3))
    clocks = {"time": T + 5.0, "stamps_imu": SLOW + 5.0, name: (SLOW + 5.0) * second}
    path = write_arrays(tmp_path / f"x{suffix}", q=Q, cmd_pos=told, cmd_on=told.T[:2], **clocks)
    log = read_log(path)
    assert [(f.severity, f.where.split(", ")[1]) for f in log.findings] == [("info", "stamps_imu")]
    assert set(log.sources) == {"q", "cmd_pos[0]", "cmd_pos[1]", "cmd_pos[2]", "cmd_on[0]", "cmd_on[1]"}
    np.testing.assert_array_equal(log.sources["cmd_pos[2]"].values, told[:, 2])
    np.testing.assert_allclose(log.sources["cmd_pos[2]"].time, SLOW + 0.1, atol=1e-9)
    np.testing.assert_allclose(log.sources["q"].time, T + 0.1, atol=1e-9)
    assert log.metadata["start"] == pytest.approx(4.9) and log.metadata["time_column"] == "time"
    only = read_log(path, ReadOptions(sources=("cmd_pos[1]",)))
    np.testing.assert_array_equal(only.sources["cmd_pos[1]"].time, log.sources["cmd_pos[1]"].time)


def test_a_map_drafted_from_an_npz_of_two_clocks_reads_it(tmp_path: Path):
    told = np.random.default_rng(0).normal(size=(80, 2)).cumsum(axis=0)
    arrays = {"time": T, "pos": np.stack([Q, -Q], axis=1), "cmd_time": SLOW, "cmd_pos": told}
    np.savez(tmp_path / "x.npz", **arrays, joint_names=np.array(["hip", "knee"]), trial=np.full(50, "a"))
    channels = ChannelSpec("knee/position", "rad", "state"), ChannelSpec("knee/target", "rad", "action")
    spec = RecordingSpec("leg", channels, (), 100.0)
    drafted = draft_map(read_log(tmp_path / "x.npz"), spec)
    assert drafted.sources["knee/target"].keys["source"] == "cmd_pos[knee]"
    by_text = drafted.log_map.model_copy(update={"episodes": EpisodeMap(by="column", column="trial")})
    with pytest.raises(MapError, match="no text for the 80 rows of 'cmd_pos"):
        read_recording([tmp_path / "x.npz"], spec, by_text)
    whole = drafted.log_map.model_copy(update={"episodes": EpisodeMap(by="file")})
    (episode,) = read_recording([tmp_path / "x.npz"], spec, whole).episodes
    last = told[np.searchsorted(SLOW, T + 1e-9, side="right") - 1, 1]  # the command that holds at each stamp
    np.testing.assert_allclose(episode.values[:30, 1], last[:30])


@pytest.mark.parametrize("clock", [None, SLOW + 100.0, SLOW[::-1]], ids=["none", "apart", "backwards"])
@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_arrays_without_a_clock_are_left_out_with_their_shape_and_what_to_do(
    suffix: str, clock, tmp_path: Path
):
    """Not so what is as short as a list of gains."""
    arrays = {"time": T, "q": Q, "cmd_pos": np.zeros((80, 3)), "kp": np.ones(3)}
    arrays |= {} if clock is None else {"cmd_time": clock}
    log = read_log(write_arrays(tmp_path / f"x{suffix}", **arrays))
    by_name = {f.where.split(", ")[1]: f for f in log.findings}
    assert set(log.sources) == {"q"} and set(log.names) == {"q"} | set(by_name)
    assert by_name["kp"].severity == "info" and by_name["cmd_pos"].severity == "warning"
    assert "shape (80, 3) for 50 time stamps" in by_name["cmd_pos"].told
    assert (
        "resample it onto 'time', or store its clock beside it, such as cmd_pos_time"
        in by_name["cmd_pos"].told
    )


def test_npz_of_objects_is_refused_in_one_line_and_damage_never_crashes(tmp_path: Path, monkeypatch):
    np.savez(tmp_path / "o.npz", time=T, q=np.array([{"a": 1}] * len(T), dtype=object))
    with pytest.raises(LogError, match="Python objects") as refused:
        read_log(tmp_path / "o.npz")
    assert "\n" not in str(refused.value)
    np.savez(tmp_path / "x.npz", time=T, q=Q)
    whole, rng = (tmp_path / "x.npz").read_bytes(), np.random.default_rng(0)
    for _ in range(150):
        data = bytearray(whole[: rng.integers(10, len(whole) + 1)])
        for at in rng.integers(4, max(len(data), 5), 6) % len(data):
            data[at] = rng.integers(256)
        (tmp_path / "y.npz").write_bytes(data)
        with contextlib.suppress(LogError):
            read_log(tmp_path / "y.npz")
    np.savez_compressed(tmp_path / "big.npz", time=np.arange(200_000.0), q=np.zeros(200_000))
    monkeypatch.setenv("DYNREG_MAX_WHOLE_BYTES", "2000000")
    with pytest.raises(LogError, match="DYNREG_MAX_WHOLE_BYTES"):
        read_log(tmp_path / "big.npz")


def test_a_matlab_file_of_matrices_and_one_of_structs(tmp_path: Path):
    savemat(tmp_path / "x.mat", {"t": T, "q": np.stack([Q, 2 * Q])})
    np.testing.assert_array_equal(read_log(tmp_path / "x.mat").sources["q[1]"].values, 2 * Q)
    savemat(tmp_path / "s.mat", {"log": {"t": T, "q": Q}})
    with pytest.raises(LogError, match="structs.*-struct"):
        read_log(tmp_path / "s.mat")


VARIANTS = {
    "comments": ("# a bench\n# of ours, 3\ntime,q\n", "{0!r},{1!r}\n", "utf-8"),
    "a comment above a header with a hash": ("# a bench\n# time,q\n", "{0!r},{1!r}\n", "utf-8"),
    "UTF-16": ("time,q\n", "{0!r},{1!r}\n", "utf-16"),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_csv_as_other_tools_write_it(variant: str, tmp_path: Path):
    head, line, encoding = VARIANTS[variant]
    text = head + "".join(line.format(t, q) for t, q in zip(T.tolist(), Q.tolist(), strict=True))
    (tmp_path / "x.csv").write_bytes(text.encode(encoding))
    np.testing.assert_array_equal(read_log(tmp_path / "x.csv").sources["q"].values, Q)


def test_csv_with_decimal_commas(tmp_path: Path):
    lines = [f"{t!r};{q!r};a, 1,5 b".replace(".", ",") for t, q in zip(T.tolist(), Q.tolist(), strict=True)]
    (tmp_path / "x.csv").write_text("time;q;who\n" + "\n".join(lines))
    log = read_log(tmp_path / "x.csv")
    np.testing.assert_array_equal(log.sources["q"].values, Q)
    assert log.labels["who"][0] == "a, 1,5 b"
