"""The bytes of the registry's files: named arrays with a header, and JSON in the one form that is hashed."""

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.errors import RegistryError
from dynreg.registry.bucket import Remote, not_as_stored
from dynreg.registry.files import unreadable


def encode_arrays(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> bytes:
    """Safetensors bytes of named arrays with a JSON header; the same arrays give the same bytes."""
    from safetensors.numpy import save

    # One metadata key: safetensors writes several in no fixed order.
    tensors = {name: np.ascontiguousarray(arrays[name]) for name in sorted(arrays)}
    return save(tensors, metadata={"dynreg": canonical_json(header)})


def arrays_of(path: Path, data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays in a safetensors file's bytes; CorruptError when they are not what `encode_arrays` makes."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        (length,) = struct.unpack_from("<Q", data)
        header = json.loads(json.loads(data[8 : 8 + length])["__metadata__"]["dynreg"])
        return _object(header), load(data)
    except (SafetensorError, struct.error, KeyError, TypeError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from error


def decode_arrays(
    source: Path | Remote, skip: str = "/", rows: Sequence[int] | None = None, only: str = ""
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a safetensors file, without those whose name starts with `skip`.

    only : what the names of all others start with.
    rows : those along the first axis that are wanted; all by default. Of a file in a bucket nothing else is fetched.

    Raises CorruptError when the file is missing or not what `encode_arrays` writes.
    """
    from safetensors import SafetensorError, safe_open

    try:
        if isinstance(source, Remote):
            return _fetched(source, skip, rows, only)
        with safe_open(str(source), framework="numpy") as stream:
            header = json.loads(stream.metadata()["dynreg"])
            names = [name for name in stream.keys() if name.startswith(only) and not name.startswith(skip)]
            arrays = {name: stream.get_tensor(name) for name in names}
            if rows is not None:
                arrays = {name: array[list(rows)] for name, array in arrays.items()}
            return _object(header), arrays
    except (*_ODD, SafetensorError) as error:
        raise not_as_stored(source, error) from error


_ODD = (OSError, LookupError, TypeError, ValueError, AttributeError, RecursionError, struct.error)
# What safetensors calls the kinds of numbers that shards hold.
_KINDS = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "I32": "<i4", "I16": "<i2", "I8": "<i1"}
_KINDS |= {"U64": "<u8", "U32": "<u4", "U16": "<u2", "U8": "<u1", "BOOL": "?"}
_HEAD = 1 << 13  # bytes that are fetched first: the length of the header, and nearly always all of it
_LONGEST = 1 << 24


def _fetched(
    file: Remote, skip: str, rows: Sequence[int] | None, only: str
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """`decode_arrays` of a file in a bucket, by ranges of its bytes; raises what an odd header makes it raise."""
    (head,) = file.ranges([(0, min(_HEAD, file.size))])
    (length,) = struct.unpack_from("<Q", head)
    if length > min(_LONGEST, file.size - 8):
        raise ValueError("its header is longer than it")
    if 8 + length > len(head):
        head += file.ranges([(len(head), 8 + length)])[0]
    told = json.loads(head[8 : 8 + length])
    header = _object(json.loads(told.pop("__metadata__")["dynreg"]))
    names = [name for name in told if name.startswith(only) and not name.startswith(skip)]
    wanted = {name: _Slab.of(told[name], 8 + length, file.size) for name in names}
    asked = {name: slab.ranges(rows) for name, slab in wanted.items()}
    parts = iter(file.ranges([one for some in asked.values() for one in some]))
    found = {name: b"".join(next(parts) for _ in some) for name, some in asked.items()}
    return header, {name: slab.array(found[name], rows) for name, slab in wanted.items()}


@dataclass(frozen=True)
class _Slab:
    """Where the bytes of an array lie in its file."""

    kind: np.dtype
    shape: tuple[int, ...]
    first: int

    @classmethod
    def of(cls, told: Mapping[str, Any], begins: int, size: int) -> "_Slab":
        """What a header tells of an array; ValueError where that cannot be."""
        kind, (first, stop) = np.dtype(_KINDS[told["dtype"]]), told["data_offsets"]
        shape = tuple(int(length) for length in told["shape"])
        fits = min((0, *shape)) == 0 and math.prod(shape) * kind.itemsize == stop - first
        if not fits or not 0 <= first <= stop <= size - begins:
            raise ValueError("an array that does not fit its place")
        return cls(kind, shape, begins + first)

    def ranges(self, rows: Sequence[int] | None) -> list[tuple[int, int]]:
        """Where these rows are, each by itself; or all as one."""
        each = math.prod(self.shape[1:]) * self.kind.itemsize
        if rows is None:
            return [(self.first, self.first + math.prod(self.shape) * self.kind.itemsize)]
        if not self.shape or max(rows) >= self.shape[0]:
            raise IndexError(f"it has no row {max(rows)}")
        return [(self.first + row * each, self.first + (row + 1) * each) for row in rows]

    def array(self, data: bytes, rows: Sequence[int] | None) -> np.ndarray:
        """The rows by their bytes."""
        shape = self.shape if rows is None else (len(rows), *self.shape[1:])
        return np.frombuffer(data, self.kind).reshape(shape).copy()


def _object(header: Any) -> dict[str, Any]:
    if not isinstance(header, dict):
        raise ValueError("its header is no JSON object")
    return header


def canonical_json(document: Any, allow_nan: bool = True) -> str:
    """JSON with sorted keys and no spaces: the form that is hashed."""
    form = {"sort_keys": True, "separators": (",", ":"), "ensure_ascii": False, "allow_nan": allow_nan}
    return json.dumps(document, default=_plain, **form)


def strict_json(document: Any) -> bytes:
    """Canonical JSON that every reader takes, as bytes; RegistryError where the document is no plain JSON."""
    try:
        return canonical_json(document, allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise RegistryError(
            f"a document that is not plain JSON: {error}",
            expected="objects, lists, text, finite numbers, true, false and null",
            do="put null where there is no number",
        ) from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")
