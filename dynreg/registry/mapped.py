"""The models of a population, of which only those that are asked for are read.

Files that lie here are mapped into memory; of files in a bucket the ranges of these models are fetched.
"""

import hashlib
import json
import mmap
import struct
import threading
from pathlib import Path

import numpy as np
from sqlalchemy import Row, select

import dynreg.registry.tables as tables
from dynreg.registry.bucket import Remote, not_as_stored
from dynreg.registry.codec import decode_arrays
from dynreg.registry.directory import Directory
from dynreg.registry.files import open_regular, unreadable
from dynreg.registry.shards import strip

_KINDS = {"F16": np.float16, "F32": np.float32, "F64": np.float64}
_WEIGHTS = "weights/"
OPEN = 256  # shards at once: each that is mapped holds a file open, and a process may hold some thousand
_ODDER = (AttributeError, OverflowError, RecursionError)  # of a header that is JSON and no header


class MappedModels:
    """The models of entries by row, which is their place in the order of numbers; needs the open registry.

    Each model is compared with its digest when it is first read, so that a walk reads no more than what it visits. A
    shard with an entry that has no digest is compared whole.

    Attributes
    ----------
    numbers : (n,) of the entries in the population, ascending.
    digests : (m,) uint64 of the first m <= n entries, see `digest_of`; none where nobody computed them.
    read : models read, each time counted.
    """

    def __init__(
        self, directory: Directory, population_id: str, numbers: np.ndarray, digests: np.ndarray | None = None
    ):
        table = tables.shards
        query = select(table).where(table.c.population_id == population_id).order_by(table.c.start)
        with directory.catalog.read() as connection:
            self._shards = connection.execute(query).all()
        self._starts = np.array([shard.start for shard in self._shards], dtype=np.int64)
        self._directory, self._open, self._opening = directory, {}, threading.Lock()
        self._sound = np.zeros(len(numbers), dtype=bool)
        self.numbers, self.read = np.asarray(numbers), 0
        self.digests = np.zeros(0, dtype=np.uint64) if digests is None else digests

    def __len__(self) -> int:
        return len(self.numbers)

    def take(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Weights by name, each (m, ...), of the entries `rows` (m,); CorruptError where they are not as stored."""
        rows = np.asarray(rows, dtype=np.int64)
        found: dict[str, np.ndarray] = {}
        numbers = self.numbers[rows]
        shards = np.searchsorted(self._starts, numbers, side="right") - 1
        for shard in dict.fromkeys(shards.tolist()):
            at = np.flatnonzero(shards == shard)
            models = self._models(shard, numbers[at] - self._starts[shard])
            self._check(rows[at], models, shard)
            for name, array in models.items():
                if name not in found:
                    found[name] = np.empty((len(rows), *array.shape[1:]), array.dtype)
                found[name][at] = array
        self.read += len(rows)
        return found

    def digests_of(self, rows: np.ndarray) -> np.ndarray:
        """(m,) uint64 of the models of the entries `rows` (m,) as they are stored."""
        arrays, found = self.take(rows), np.empty(len(rows), dtype=np.uint64)
        for at in range(len(rows)):
            found[at] = digest_of({name: array[at] for name, array in arrays.items()})
        return found

    def _models(self, shard: int, places: np.ndarray) -> dict[str, np.ndarray]:
        """Weights by name, each (m, ...), of the entries at these places of a shard."""
        held = self._held(shard)
        if isinstance(held, Remote):
            _, arrays = decode_arrays(held, rows=places.tolist(), only=_WEIGHTS)
            return strip(arrays, _WEIGHTS)
        return {name: array[places] for name, array in held.items()}

    def _held(self, shard: int) -> dict[str, np.ndarray] | Remote:
        """A shard as `_opened` gives it, one of the last that were opened; several threads may ask at once."""
        with self._opening:
            if shard not in self._open:
                while len(self._open) >= OPEN:
                    del self._open[next(iter(self._open))]
                self._open[shard] = self._opened(self._shards[shard])
            return self._open[shard]

    def _opened(self, told: Row) -> dict[str, np.ndarray] | Remote:
        """A shard's weights in mapped memory; the file itself where it lies in a bucket and not here."""
        if np.searchsorted(self.numbers, told.stop) > len(self.digests):
            (path,) = self._directory.checked(told.arrays_path)
        elif self._directory.bucket is None:
            path = self._directory.locate(told.arrays_path)
        else:
            (path,) = self._directory.near(told.arrays_path)
        return path if isinstance(path, Remote) else _mapped(path, told)

    def _check(self, rows: np.ndarray, models: dict[str, np.ndarray], shard: int) -> None:
        for at in np.flatnonzero(~self._sound[rows] & (rows < len(self.digests))):
            if digest_of({name: array[at] for name, array in models.items()}) != self.digests[rows[at]]:
                held, path = self._held(shard), self._directory.locate(self._shards[shard].arrays_path)
                source = held if isinstance(held, Remote) else path
                raise not_as_stored(source, "a model in it is not the one that was registered")
            self._sound[rows[at]] = True


def digest_of(model: dict[str, np.ndarray]) -> int:
    """The first 64 bits of the SHA-256 of a model's weights, in the order of their names."""
    digest = hashlib.sha256()
    for name in sorted(model):
        digest.update(np.ascontiguousarray(model[name]))
    return int.from_bytes(digest.digest()[:8], "little")


def _mapped(path: Path, told: Row) -> dict[str, np.ndarray]:
    """The weights in a shard's file, without those bytes being read; CorruptError where it is none of a shard's."""
    rows = told.stop - told.start
    try:
        with open_regular(path) as file:
            memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        (length,) = struct.unpack_from("<Q", memory)
        header, begin = json.loads(memory[8 : 8 + length]), 8 + length
        return {
            name.removeprefix(_WEIGHTS): _array(memory, begin, tensor, rows)
            for name, tensor in header.items()
            if name.startswith(_WEIGHTS)
        }
    except (OSError, struct.error, KeyError, TypeError, ValueError, *_ODDER) as error:
        raise unreadable(path, error) from error


def _array(memory: mmap.mmap, begin: int, tensor: dict, rows: int) -> np.ndarray:
    """A view of one tensor of a safetensors file; ValueError where it is not of so many entries."""
    kind, shape, (first, stop) = np.dtype(_KINDS[tensor["dtype"]]), tensor["shape"], tensor["data_offsets"]
    count = int(np.prod(shape, dtype=np.int64))
    if not shape or shape[0] != rows or not 0 <= first <= stop or stop - first != count * kind.itemsize:
        raise ValueError(f"it holds an array of the shape {shape}, where there are {rows} entries")
    return np.frombuffer(memory, kind, count, begin + first).reshape(shape)
