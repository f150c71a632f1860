"""Tables of every kind become the columns that were written."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat, savemat

from dynreg.data.readers import ReadOptions, read_log
from dynreg.errors import LogError

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
