"""A LeRobot dataset of version 3.0: https://github.com/huggingface/lerobot."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dynreg.data.recording import SAME_RATE
from dynreg.data.trajectories import Columns, Trajectories, numbers
from dynreg.datasets.dataset import GROUP
from dynreg.datasets.export import Export
from dynreg.errors import UsageError

VERSION = "v3.0"
FILE_MB, CHUNK = 100, 1000  # LeRobot's own: megabytes of a file, files of a chunk
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_INTEGERS = ("frame_index", "episode_index", "index", "task_index", "entry_index")


def check(export: Export) -> None:
    """UsageError where rows or episodes are at different rates, or nobody told them: LeRobot knows one `fps`."""
    if uneven := export.dataset.uneven:
        raise UsageError(
            f"episode {uneven[0]!r} with uneven times as lerobot",
            expected="rows at one rate: a LeRobot dataset has one fps",
            do="choose parquet, which keeps the time of each row",
        )
    rates = 1.0 / export.dataset.periods
    rates = rates[np.isfinite(rates)]
    if not len(rates):
        raise UsageError(
            "a dataset without times as lerobot", expected="rows at a known rate", do="choose parquet"
        )
    if rates.max() > rates.min() * (1 + SAME_RATE):
        raise UsageError(
            f"episodes at {rates.min():.4g} to {rates.max():.4g} Hz as lerobot",
            expected="one rate: a LeRobot dataset has one fps",
            do="name entries of the same rate, or choose parquet, which keeps the time of each row",
        )


def fps_of(export: Export) -> float:
    """Frames a second: the median rate, a whole number where it is one but for the clock's error."""
    rate = float(1.0 / np.nanmedian(export.dataset.periods))
    return round(rate) if abs(round(rate) / rate - 1) < SAME_RATE else rate


def write(export: Export, folder: Path, name: str) -> None:
    """data/, meta/info.json, stats.json, tasks.parquet, episodes/ and, of dynreg's own, entries.parquet."""
    columns, fps = export.dataset.columns, fps_of(export)
    features = _features(columns)
    stats = {key: _Stats() for key in features}
    frames = episodes = 0
    (folder / EPISODES).parent.mkdir(parents=True)
    with pq.ParquetWriter(folder / EPISODES, _EPISODE, compression="zstd") as told:
        data = _Files(folder, _schema(features))
        for entry, one in enumerate_entries(export):
            table = _frames(one, columns, fps, entry, episodes, frames, features)
            chunk, file = data.write(table)
            for key in features:
                stats[key].add(table[key])
            count, length = one.states.shape[0] * one.states.shape[1], one.states.shape[2]
            told.write_table(_episodes(one, chunk, file, episodes, frames, count, length))
            episodes, frames = episodes + count, frames + count * length
        data.close()
    info = {
        "codebase_version": VERSION,
        "robot_type": export.dataset.robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA,
        "video_path": None,
        "features": features,
    }
    _json(folder / "meta/info.json", info)
    _json(folder / "meta/stats.json", {key: one.told() for key, one in stats.items()})
    _tasks(folder / "meta/tasks.parquet", _TASK)
    pq.write_table(export.table(), folder / "meta/entries.parquet", compression="zstd")


_TASK = "follow the commands"  # there is no other


def enumerate_entries(export: Export) -> Iterator[tuple[int, Trajectories]]:
    """Some entries at a time, with which the first of them is among all."""
    rank = {identity: i for i, identity in enumerate(dict.fromkeys(export.dataset.entries))}
    for one in export.dataset.trajectories():
        for some in one.split(GROUP):
            yield rank[some.entries[0]], some


def _features(columns: Columns) -> dict[str, dict[str, Any]]:
    named = {
        "observation.state": [c.name for c in columns.states],
        "observation.environment_state": [c.name for c in columns.context],
        "action": [c.name for c in columns.actions],
    }
    out = {k: {"dtype": "float32", "shape": [len(v)], "names": v} for k, v in named.items() if v}
    scalars = {"timestamp": "float32", "time": "float64", **dict.fromkeys(_INTEGERS, "int64")}
    return out | {key: {"dtype": kind, "shape": [1], "names": None} for key, kind in scalars.items()}


def _schema(features: dict[str, dict[str, Any]]) -> pa.Schema:
    def kind(told: dict[str, Any]) -> pa.DataType:
        alone = pa.from_numpy_dtype(told["dtype"])
        width = told["shape"][0]
        return (
            alone if width == 1 else pa.list_(alone, width)
        )  # a vector of one number is a number in LeRobot

    return pa.schema([(key, kind(told)) for key, told in features.items()])


def _frames(
    one: Trajectories,
    columns: Columns,
    fps: float,
    entry: int,
    episode: int,
    frame: int,
    features: dict[str, dict[str, Any]],
) -> pa.Table:
    """Rows (n E T+1) of some entries; the numbers of the first entry, episode and frame are told."""
    n, episodes, steps = one.states.shape[:3]
    shape = (n, episodes, steps)
    step = np.broadcast_to(np.arange(steps), shape)
    context = np.concatenate([_held(one.inputs), one.context[..., one.inputs.shape[-1] :]], axis=-1)
    values = {
        "observation.state": one.states,
        "observation.environment_state": np.broadcast_to(context, (*shape, len(columns.context))),
        "action": np.broadcast_to(_held(one.actions), (*shape, len(columns.actions))),
        "timestamp": step / fps,
        "time": step / fps if one.time is None else one.time,
        "frame_index": step,
        "episode_index": np.broadcast_to((episode + np.arange(n * episodes)).reshape(n, episodes, 1), shape),
        "index": (frame + np.arange(n * episodes * steps)).reshape(shape),
        "task_index": np.zeros(shape),
        "entry_index": np.broadcast_to((entry + np.arange(n))[:, None, None], shape),
    }
    schema = _schema(features)
    arrays = []
    for field in schema:
        kind = np.dtype(features[field.name]["dtype"])
        flat = numbers(np.ascontiguousarray(values[field.name], kind).ravel())
        is_vector = pa.types.is_fixed_size_list(field.type)
        arrays.append(pa.FixedSizeListArray.from_arrays(flat, type=field.type) if is_vector else flat)
    return pa.Table.from_arrays(arrays, schema=schema)


def _held(values: np.ndarray) -> np.ndarray:
    """Commands or inputs (E, T+1, ...) in which none follows the last state: what was told before it is held."""
    out = values.copy()
    if out.shape[1] > 1:
        out[:, -1] = np.where(np.isnan(out[:, -1]), out[:, -2], out[:, -1])
    return out


class _Files:
    """The data files: a new one where the last is full."""

    def __init__(self, folder: Path, schema: pa.Schema):
        self.folder, self.schema, self.at, self.bytes = folder, schema, -1, FILE_MB * 1e6
        self.writer: pq.ParquetWriter | None = None

    def write(self, table: pa.Table) -> tuple[int, int]:
        """Append rows; the chunk and the file in it that have them."""
        if self.bytes + table.nbytes > FILE_MB * 1e6:
            self.close()
            self.at, self.bytes = self.at + 1, 0
            path = self.folder / DATA.format(chunk_index=self.at // CHUNK, file_index=self.at % CHUNK)
            path.parent.mkdir(parents=True, exist_ok=True)
            self.writer = pq.ParquetWriter(path, self.schema, compression="zstd")
        self.writer.write_table(table)
        self.bytes += table.nbytes
        return self.at // CHUNK, self.at % CHUNK

    def close(self) -> None:
        if self.writer is not None:
            self.writer.close()


_EPISODE = pa.schema(
    [
        ("episode_index", pa.int64()),
        ("tasks", pa.list_(pa.string())),
        ("length", pa.int64()),
        ("data/chunk_index", pa.int64()),
        ("data/file_index", pa.int64()),
        ("dataset_from_index", pa.int64()),
        ("dataset_to_index", pa.int64()),
        ("meta/episodes/chunk_index", pa.int64()),
        ("meta/episodes/file_index", pa.int64()),
        ("entry", pa.string()),
        ("episode", pa.string()),
    ]
)


def _episodes(
    one: Trajectories, chunk: int, file: int, episode: int, frame: int, count: int, length: int
) -> pa.Table:
    begins = frame + length * np.arange(count)
    columns = {
        "episode_index": episode + np.arange(count),
        "tasks": [[_TASK]] * count,
        "length": np.full(count, length),
        "data/chunk_index": np.full(count, chunk),
        "data/file_index": np.full(count, file),
        "dataset_from_index": begins,
        "dataset_to_index": begins + length,
        "meta/episodes/chunk_index": np.zeros(count, int),
        "meta/episodes/file_index": np.zeros(count, int),
        "entry": [entry for entry in one.entries for _ in one.episodes],
        "episode": [str(name) for _ in one.entries for name in one.episodes],
    }
    return pa.Table.from_pydict(columns, _EPISODE)


class _Stats:
    """Least, greatest, mean and standard deviation of a column, batch by batch, gaps left out."""

    def __init__(self):
        self.count, self.sums, self.squares, self.low, self.high = 0, 0.0, 0.0, np.inf, -np.inf

    def add(self, column: pa.ChunkedArray) -> None:
        array = column.combine_chunks()
        width = array.type.list_size if pa.types.is_fixed_size_list(array.type) else 1
        values = (array.flatten() if width > 1 else array).to_numpy(zero_copy_only=False)
        values = values.reshape(-1, width).astype(np.float64)
        there = np.isfinite(values)
        filled = np.where(there, values, 0.0)
        self.count = self.count + there.sum(axis=0)
        self.sums, self.squares = self.sums + filled.sum(axis=0), self.squares + (filled**2).sum(axis=0)
        self.low = np.minimum(self.low, np.where(there, values, np.inf).min(axis=0))
        self.high = np.maximum(self.high, np.where(there, values, -np.inf).max(axis=0))

    def told(self) -> dict[str, list[float]]:
        """Lists (width,) by name; 0 of a column without a number. count : (1,) the most of any."""
        known = np.maximum(self.count, 1)
        mean = self.sums / known
        deviation = np.sqrt(np.maximum(self.squares / known - mean**2, 0.0))
        some = {"min": self.low, "max": self.high, "mean": mean, "std": deviation}
        out = {key: np.where(self.count > 0, value, 0.0).tolist() for key, value in some.items()}
        return out | {"count": [int(self.count.max())]}


def _tasks(path: Path, task: str) -> None:
    """The table of tasks; LeRobot finds their words in the index of a pandas frame."""
    import pandas as pd

    frame = pd.DataFrame({"task_index": [0]}, index=[task])
    pq.write_table(pa.Table.from_pandas(frame), path)


def _json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=4, ensure_ascii=False), encoding="utf-8")
