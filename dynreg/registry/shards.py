"""A shard on disk: one Parquet file of rows that explains itself, and one safetensors file of models and losses.

Each row of the Parquet file is a state of an entry, with the command that follows it: `entry`, `number`, `episode`,
`step`, `time`, then states, actions, inputs and settings by name. A field's metadata tells its unit and its role, the
schema's metadata the parameters of each entry. The two files tell all that the catalogue says of their entries, so that
it can be rebuilt from them.
"""

import mmap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dynreg.errors import RegistryError
from dynreg.registry.bucket import Remote, not_as_stored
from dynreg.registry.codec import canonical_json, decode_arrays, encode_arrays
from dynreg.registry.files import open_regular, unreadable
from dynreg.registry.headers import SCHEMA, TOGETHER, check_size, checked_header, is_old, together
from dynreg.registry.records import PopulationRecord, ShardData

# What a damaged file makes its readers raise.
_ODD = (
    OSError,
    pa.ArrowException,
    KeyError,
    TypeError,
    IndexError,
    ValueError,
    OverflowError,
    RecursionError,
)


def encode_rows(data: ShardData, record: PopulationRecord, start: int, ids: Sequence[str]) -> bytes:
    """Parquet bytes of the rows of entries `start` to `start + len(data)`; the same entries give the same bytes.

    ids : of the entries. Times are left out where nobody told them. Raises LimitError where they are too many numbers
    to be read again.
    """
    n, episodes, steps, _ = data.states.shape
    check_size(f"entries {start} to {start + n} of a population", data.states.shape)
    numbers = np.arange(start, start + n)
    table = record.trajectories(ids, numbers, data.states, data.periods).table()
    header = _header(data, record, start, ids)
    table = table.replace_schema_metadata({"dynreg": canonical_json(header)})
    # Splitting the bytes of floats makes them smaller and, decoded from the cache, quicker to read.
    encoding = {channel.name: "BYTE_STREAM_SPLIT" for channel in record.channels}
    encoding |= {name: "DELTA_BINARY_PACKED" for name in ("number", "episode", "step")}
    sink = pa.BufferOutputStream()
    pq.write_table(
        table,
        sink,
        row_group_size=TOGETHER * episodes * steps,
        compression="zstd",
        compression_level=3,
        use_dictionary=[name for name in table.column_names if name not in encoding],
        write_statistics=["entry", "number"],
        column_encoding=encoding,
    )
    return sink.getvalue().to_pybytes()


def _header(data: ShardData, record: PopulationRecord, start: int, ids: Sequence[str]) -> dict[str, Any]:
    """What the schema's metadata tells: whose rows these are, and the parameters and losses of each entry."""
    parameters = {
        name: {"unit": unit, "values": values}
        for (name, unit), values in zip(record.units.items(), data.values.T.tolist(), strict=True)
    }
    columns = record.columns.by_role
    return {
        "schema": SCHEMA,
        "columns": {c.name: {"role": role, "unit": c.unit} for role, some in columns.items() for c in some},
        "population": record.id,
        "robot": {"name": record.name, "hash": record.robot_hash},
        "start": start,
        "stop": start + len(data),
        "shape": data.states.shape,
        "states": [channel.name for channel in record.channels],
        "entries": list(ids),
        "parameters": parameters,
        "own_loss": data.own_loss.tolist(),
        "periods": None if data.periods is None else data.periods.tolist(),
    }


def _values(column: pa.Array) -> np.ndarray:
    # to_numpy() would load pandas, too.
    if column.type != pa.float32() or column.null_count:
        raise ValueError(f"a channel of {column.type} with {column.null_count} gaps")
    return np.frombuffer(column.buffers()[1], np.float32, len(column), 4 * column.offset)


def check_told(header: dict[str, Any], data: ShardData, record: PopulationRecord) -> None:
    """ValueError where a shard's header tells strangers something else of its entries than its arrays hold."""
    if is_old(header):
        return
    right = _header(data, record, header["start"], data.entry_ids(record.id))
    for key in ("entries", "parameters", "own_loss", "columns"):
        if canonical_json(header.get(key)) != canonical_json(right[key]):
            raise ValueError(f"what its header tells under {key!r} is not what it holds")


def encode_rest(data: ShardData, header: dict[str, Any]) -> bytes:
    """Safetensors bytes of everything but the states."""
    arrays = {"values": data.values, "own_loss": data.own_loss, "train_loss": data.train_loss}
    arrays |= {f"weights/{name}": array for name, array in data.weights.items()}
    arrays |= {f"extra/{name}": array for name, array in data.extra.items()}
    return encode_arrays(arrays, header)


def read_states_header(path: Path | Remote) -> dict[str, Any]:
    """The header of a Parquet shard, with `shape` (n, E, T+1, S), the names of its `states` and `periods` (n, E).

    Raises CorruptError where it is none of a shard's, or does not fit the row groups.
    """
    try:
        with _opened(path) as stream:
            return checked_header(path, stream)
    except _ODD as error:
        raise not_as_stored(path, error) from error


def read_states(path: Path | Remote, out: np.ndarray, first: int = 0) -> None:
    """Decode entries `first` to `first + len(out)` of a Parquet shard into `out` (n, E, T+1, S).

    Raises CorruptError when the file is missing, damaged or of another shape.
    """
    count, episodes, steps, channels = out.shape
    rows = episodes * steps
    flat = out.reshape(-1, channels)
    at = 0
    try:
        with _opened(path) as stream:
            header = checked_header(path, stream)
            names, per = header["states"], together(header)
            if header["shape"][1:] != [episodes, steps, channels]:
                raise ValueError(
                    f"its entries are of the shape {header['shape'][1:]}, not {list(out.shape[1:])}"
                )
            groups = range(first // per, (first + count - 1) // per + 1)
            skip = (first - groups.start * per) * rows
            for columns in _decoded(stream, names, groups, TOGETHER * rows):
                length = len(columns[0])
                begin, end = min(skip, length), min(length, skip + len(flat) - at)
                for j, column in enumerate(columns):
                    flat[at : at + end - begin, j] = column[begin:end]
                at, skip = at + end - begin, skip - begin
    except _ODD as error:
        raise not_as_stored(path, error) from error
    if at != len(flat):
        raise not_as_stored(path, f"it holds {at} rows, not {len(flat)}")


def _decoded(
    stream: pq.ParquetFile, names: Sequence[str], groups: range, rows: int
) -> Iterator[list[np.ndarray]]:
    """Columns of these row groups, a few entries at a time: small enough to stay in the cache until they are copied."""
    batches = stream.iter_batches(batch_size=rows, row_groups=groups, columns=list(names), use_threads=False)
    for batch in batches:
        yield [_values(batch.column(name)) for name in names]


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
            header["periods"],
        )
    except KeyError as error:
        raise unreadable(rest_path, f"it lacks {error}") from error
    except (RegistryError, TypeError, ValueError) as error:  # arrays that do not fit each other
        raise unreadable(rest_path, getattr(error, "problem", str(error))) from error


def strip(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """The arrays below `prefix`, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _opened(source: Path | Remote) -> pq.ParquetFile:
    """A Parquet file in mapped memory, or one in a bucket of which only the parts that are read are fetched.

    Arrow is not told its name, in which it may see an address or a home folder.
    """
    if isinstance(source, Remote):
        return pq.ParquetFile(pa.PythonFile(source.opened(), mode="r"), pre_buffer=True)
    with open_regular(source) as file:
        return pq.ParquetFile(pa.py_buffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)))
