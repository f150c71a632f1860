"""A shard on disk: one Parquet file of states, one row group an entry, and one safetensors file of the rest.

The two files tell all that the catalogue says of their entries, so that it can be rebuilt from them.
"""

import json
import mmap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dynreg.data.recording import Channel
from dynreg.errors import CorruptError
from dynreg.limits import limits, refuse
from dynreg.registry.codec import canonical_json, decode_arrays, encode_arrays
from dynreg.registry.files import open_regular, unreadable
from dynreg.registry.records import ShardData

_READ_TOGETHER = 20  # row groups decoded before they are copied out: small enough to stay in the cache


def encode_states(states: np.ndarray, channels: Sequence[Channel], header: dict[str, Any]) -> bytes:
    """Parquet bytes of states (n, E, T+1, S): columns `episode`, `step` and one float32 a channel.

    One row group for each of the n entries; the unit of a channel is in its field's metadata. The same
    states give the same bytes.
    """
    n, episodes, steps, _ = states.shape
    episode = np.tile(np.repeat(np.arange(episodes, dtype=np.int16), steps), n)
    step = np.tile(np.arange(steps, dtype=np.int16), n * episodes)
    columns = np.ascontiguousarray(states.reshape(n * episodes * steps, -1).T)
    fields = [pa.field("episode", pa.int16()), pa.field("step", pa.int16())]
    fields += [pa.field(c.name, pa.float32(), metadata={"unit": c.unit}) for c in channels]
    schema = pa.schema(fields, metadata={"dynreg": canonical_json(header | {"shape": states.shape})})
    # pa.array() would load pandas to see whether it was given some of it.
    arrays = [
        pa.Array.from_buffers(pa.from_numpy_dtype(c.dtype), len(c), [None, pa.py_buffer(c)])
        for c in (episode, step, *columns)
    ]
    table = pa.Table.from_arrays(arrays, schema=schema)
    # Splitting the bytes of floats makes them smaller and, decoded from the cache, quicker to read.
    encoding = {c.name: "BYTE_STREAM_SPLIT" for c in channels}
    encoding |= {"episode": "DELTA_BINARY_PACKED", "step": "DELTA_BINARY_PACKED"}
    sink = pa.BufferOutputStream()
    pq.write_table(
        table,
        sink,
        row_group_size=episodes * steps,
        compression="zstd",
        compression_level=3,
        use_dictionary=False,
        write_statistics=False,
        column_encoding=encoding,
    )
    return sink.getvalue().to_pybytes()


def _values(column: pa.Array) -> np.ndarray:
    # to_numpy() would load pandas, too.
    if column.type != pa.float32() or column.null_count:
        raise ValueError(f"a channel of {column.type} with {column.null_count} gaps")
    return np.frombuffer(column.buffers()[1], np.float32, len(column), 4 * column.offset)


def encode_rest(data: ShardData, header: dict[str, Any]) -> bytes:
    """Safetensors bytes of everything but the states."""
    arrays = {"values": data.values, "own_loss": data.own_loss, "train_loss": data.train_loss}
    arrays |= {f"weights/{name}": array for name, array in data.weights.items()}
    arrays |= {f"extra/{name}": array for name, array in data.extra.items()}
    return encode_arrays(arrays, header)


def read_states_header(path: Path) -> dict[str, Any]:
    """The header of a Parquet shard, with `shape` (n, E, T+1, S) and the `channels` it holds.

    Raises CorruptError when its row groups are not one an entry.
    """
    try:
        with _mapped(path) as stream:
            header = json.loads(stream.schema_arrow.metadata[b"dynreg"])
            n, episodes, steps, channels = header["shape"]
            if n * episodes * steps * channels > limits().numbers:
                refuse(CorruptError, path.name, f"{n * episodes * steps * channels} numbers", "numbers")
            rows = {stream.metadata.row_group(i).num_rows for i in range(stream.num_row_groups)}
            header["channels"] = stream.schema_arrow.names[2:]
            whole = stream.num_row_groups == n and rows == {episodes * steps}
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from error
    if not whole:
        raise unreadable(path, f"it has {stream.num_row_groups} row groups of {rows} rows")
    return header


def read_states(path: Path, out: np.ndarray, first: int = 0) -> None:
    """Decode entries `first` to `first + len(out)` of a Parquet shard into `out` (n, E, T+1, S).

    Raises CorruptError when the file is missing, damaged or of another shape.
    """
    count, episodes, steps, channels = out.shape
    flat = out.reshape(-1, channels)
    at = 0
    try:
        with _mapped(path) as stream:
            names = stream.schema_arrow.names[2:]
            if len(names) != channels:
                raise ValueError(f"it has {len(names)} channels, not {channels}")
            batches = stream.iter_batches(
                batch_size=_READ_TOGETHER * episodes * steps,
                row_groups=range(first, first + count),
                columns=names,
                use_threads=False,
            )
            for batch in batches:
                for j, column in enumerate(batch.columns):
                    flat[at : at + len(column), j] = _values(column)
                at += batch.num_rows
    except (OSError, pa.ArrowException, IndexError, ValueError) as error:
        raise unreadable(path, error) from error
    if at != len(flat):
        raise unreadable(path, f"it holds {at} rows, not {len(flat)}")


def read_shard(states_path: Path, rest_path: Path) -> tuple[dict[str, Any], ShardData]:
    """Header and contents of both files of a shard; CorruptError when they are damaged or do not fit."""
    header = read_states_header(states_path)
    rest_header, arrays = decode_arrays(rest_path)
    if any(rest_header.get(key) != header.get(key) for key in ("population", "start", "stop")):
        raise unreadable(rest_path, "it belongs to another shard")
    states = np.empty(header["shape"], np.float32)
    read_states(states_path, states)
    try:
        return header, ShardData(
            arrays["values"],
            states,
            strip(arrays, "weights/"),
            arrays["own_loss"],
            arrays["train_loss"],
            strip(arrays, "extra/"),
        )
    except KeyError as error:
        raise unreadable(rest_path, f"it lacks {error}") from error


def strip(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """The arrays below `prefix`, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _mapped(path: Path) -> pq.ParquetFile:
    """A Parquet file in mapped memory. Arrow is not told its name, in which it may see an address or a home folder."""
    with open_regular(path) as file:
        return pq.ParquetFile(pa.py_buffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)))
