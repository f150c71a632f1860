"""Files in a bucket: S3 by `pyarrow.fs`, or whatever else that reaches. It counts what it fetches.

An object is there whole or not at all, so nothing is written under a temporary name.
"""

import hashlib
import io
import secrets
import shutil
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from dynreg.errors import RegistryError
from dynreg.registry.files import unreadable
from dynreg.registry.reaching import absent, explained, lost, reached

_AT_ONCE = 16  # requests side by side: S3 answers one in some 20 to 50 ms, however small it is
_DIGEST = 32
# Bytes: ranges that are nearer to each other are fetched as one. At 1 << 16 a walk fetched 2.6 times what it asked for.
_GAP = 1 << 12


class Bucket:
    """Objects below a prefix, by names as in a registry's folder.

    Attributes
    ----------
    uri : such as s3://bucket/prefix, with ?region=, ?endpoint_override= and ?scheme= where it is no bucket of Amazon's.
    kept : folder for the parts of objects that were fetched; None to keep none.
    fetched, requests : bytes that were read since it was opened, and in how many requests.
    """

    def __init__(self, uri: str, kept: Path | None = None):
        self.uri = uri
        self.kept = kept
        self.fetched, self.requests = 0, 0
        self._counting = threading.Lock()
        self._files, self._base = reached(uri)

    def check(self) -> None:
        """Raises NoPlaceError where the bucket is not there, or cannot be reached or read."""
        from pyarrow.fs import FileType

        bucket = self._base.split("/")[0] if self.uri.startswith("s3:") else self._base
        with self._telling(""):
            if (
                self.uri.startswith("s3:")
                and self._files.get_file_info(bucket).type is not FileType.Directory
            ):
                raise absent(self.uri)
            self.names("ledger")

    def read(self, name: str) -> bytes:
        """All bytes of an object; FileNotFoundError where there is none."""
        with self._telling(name), self._files.open_input_file(self._path(name)) as stream:
            data = stream.read()
        self._count(len(data), 1)
        return data

    def read_ranges(self, file: "Remote", ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """Bytes `first` to `stop` of an object for each (first, stop), side by side.

        Raises FileNotFoundError as `read`, and CorruptError where the object is shorter.
        """
        pieces = _joined(ranges)
        with self._telling(file.name), self._files.open_input_file(self._path(file.name)) as stream:
            if pieces[-1][1] > stream.size():
                raise lost(file, "it ends before it should")
            if len(pieces) > 1:
                with ThreadPoolExecutor(min(_AT_ONCE, len(pieces))) as pool:
                    parts = list(pool.map(lambda p: stream.read_at(p[1] - p[0], p[0]), pieces))
            else:
                parts = [stream.read_at(stop - first, first) for first, stop in pieces]
        self._count(sum(map(len, parts)), len(parts))
        return [_cut(pieces, parts, first, stop) for first, stop in ranges]

    def write(self, name: str, data: bytes) -> None:
        """Put an object, in place of one of that name; it outlasts a power cut when this returns."""
        with self._telling(name), self._files.open_output_stream(self._path(name)) as stream:
            stream.write(data)

    def size(self, name: str) -> int | None:
        """Bytes of an object; None where there is none."""
        from pyarrow.fs import FileType

        with self._telling(name):
            told = self._files.get_file_info(self._path(name))
        return told.size if told.type is FileType.File else None

    def names(self, folder: str) -> dict[str, int]:
        """{name: bytes} of the objects below a folder, however deep."""
        from pyarrow.fs import FileSelector, FileType

        at = len(self._base) + 1
        with self._telling(folder):
            told = self._files.get_file_info(
                FileSelector(self._path(folder), recursive=True, allow_not_found=True)
            )
        return {info.path[at:]: info.size for info in told if info.type is FileType.File}

    def remove(self, name: str) -> None:
        """Remove an object; nothing where it is gone already."""
        with self._telling(name):
            try:
                self._files.delete_file(self._path(name))
            except FileNotFoundError:
                pass

    def _path(self, name: str) -> str:
        return f"{self._base}/{name}" if name else self._base

    def _count(self, size: int, requests: int) -> None:
        with self._counting:
            self.fetched += size
            self.requests += requests

    @contextmanager
    def _telling(self, name: str) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError:
            raise
        except OSError as error:
            raise explained(self.uri, name, error) from error


@dataclass(frozen=True)
class Remote:
    """A registered object of which parts are read where it lies: its name, its bytes in all."""

    bucket: Bucket
    name: str
    size: int

    def __str__(self) -> str:
        return f"{self.bucket.uri.partition('?')[0]}/{self.name}"

    def ranges(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """Bytes `first` to `stop` for each (first, stop); raises as `Bucket.read_ranges`."""
        found = {one: self._part(*one) for one in ranges}
        missing = [one for one, data in found.items() if data is None]
        fetched = self.bucket.read_ranges(self, missing) if missing else []
        for one, data in zip(missing, fetched, strict=True):
            self._keep(*one, data)
            found[one] = data
        return [found[one] for one in ranges]

    def forget(self) -> None:
        """Remove the parts that are kept of it."""
        if self.bucket.kept is not None:
            shutil.rmtree(self.bucket.kept / self.name, ignore_errors=True)

    def _place(self, first: int, stop: int) -> Path:
        return self.bucket.kept / self.name / f"{first}-{stop}"

    def _part(self, first: int, stop: int) -> bytes | None:
        """What was fetched before, as long as it is as it was."""
        if self.bucket.kept is None:
            return None
        try:
            kept = self._place(first, stop).read_bytes()
        except OSError:
            return None
        digest, data = kept[:_DIGEST], kept[_DIGEST:]
        return data if hashlib.sha256(data).digest() == digest else None

    def _keep(self, first: int, stop: int, data: bytes) -> None:
        if self.bucket.kept is None:
            return
        place = self._place(first, stop)
        hidden = place.with_name(f".{place.name}-{secrets.token_hex(6)}")
        with suppress(OSError):  # no more than a copy: where there is no room for it, it is fetched again
            place.parent.mkdir(parents=True, exist_ok=True)
            hidden.write_bytes(hashlib.sha256(data).digest() + data)
            hidden.replace(place)

    def opened(self) -> io.RawIOBase:
        """A stream that fetches what is read of it."""
        return _Ranged(self)


class _Ranged(io.RawIOBase):
    def __init__(self, file: Remote):
        self._file, self._at = file, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + (0, self._at, self._file.size)[whence]
        return self._at

    def read(self, size: int = -1) -> bytes:
        stop = self._file.size if size < 0 else min(self._file.size, self._at + size)
        if stop <= self._at:
            return b""
        (data,) = self._file.ranges([(self._at, stop)])
        self._at = stop
        return data


def not_as_stored(source: object, error: Exception | str) -> RegistryError:
    """`unreadable`; of an object no part is kept here any more, since what lies in the bucket may be mended by now."""
    if isinstance(source, Remote):
        source.forget()
    return unreadable(source, error)


def _joined(ranges: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Ranges in order, those near to each other as one."""
    pieces: list[tuple[int, int]] = []
    for first, stop in sorted(ranges):
        if pieces and first - pieces[-1][1] <= _GAP:
            pieces[-1] = pieces[-1][0], max(stop, pieces[-1][1])
        else:
            pieces.append((first, stop))
    return pieces


def _cut(pieces: Sequence[tuple[int, int]], parts: Sequence[bytes], first: int, stop: int) -> bytes:
    at = next(i for i, (begin, end) in enumerate(pieces) if begin <= first and stop <= end)
    return parts[at][first - pieces[at][0] : stop - pieces[at][0]]
