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
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlsplit

from dynreg.errors import CorruptError, NoPlaceError, RegistryError, UsageError
from dynreg.registry.files import unreadable

if TYPE_CHECKING:
    from pyarrow.fs import FileSystem

_SECRET = {"access_key", "secret_key", "session_token", "external_id"}  # of S3, and of other stores:
_SECRET |= {"access_token", "account_key", "client_secret", "sas_token"}
_OPTIONS = {"region", "scheme", "endpoint_override"}
_ATTEMPTS, _CONNECT_SECONDS, _REQUEST_SECONDS = 4, 5, 60
_AT_ONCE = 16  # requests side by side: S3 answers one in some 20 to 50 ms, however small it is
_DIGEST = 32
_GAP = 1 << 16  # bytes: ranges that are nearer to each other are fetched as one


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
        self._files, self._base = _reached(uri)

    def check(self) -> None:
        """Raises NoPlaceError where the bucket is not there, or cannot be reached or read."""
        from pyarrow.fs import FileType

        bucket = self._base.split("/")[0] if self.uri.startswith("s3:") else self._base
        with self._telling(""):
            if (
                self.uri.startswith("s3:")
                and self._files.get_file_info(bucket).type is not FileType.Directory
            ):
                raise _absent(self.uri)
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


def explained(uri: str, name: str, error: OSError) -> RegistryError:
    """The meaning of what pyarrow says of a bucket; never with a key or a secret in it."""
    text, what = str(error), f"the bucket {uri.partition('?')[0]!r}"
    code = next((word for word in _CODES if word in text.upper()), "")
    if code == "NO_SUCH_BUCKET":
        return _absent(uri)
    if code in _RIGHTS:
        return NoPlaceError(
            f"{what} refuses{f' {name!r}' if name else ''}: {code}",
            expected="keys with the right to list, read, write and delete below this prefix",
            do="set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY (or AWS_PROFILE), or mend the bucket's policy",
        )
    return NoPlaceError(
        f"{what} cannot be reached{f', or {name!r} in it' if name else ''}: {_brief(text)}",
        expected="a bucket that answers at this address",
        do="look after the network, the region and the address, then run the same command again",
    )


_RIGHTS = (
    "ACCESS_DENIED",
    "INVALID_ACCESS_KEY_ID",
    "SIGNATURE_DOES_NOT_MATCH",
    "INVALID_CLIENT_TOKEN_ID",
    "EXPIRED_TOKEN",
    "HTTP STATUS 403",
)
_CODES = ("NO_SUCH_BUCKET", *_RIGHTS)


def not_as_stored(source: object, error: Exception | str) -> RegistryError:
    """`unreadable`; of an object no part is kept here any more, since what lies in the bucket may be mended by now."""
    if isinstance(source, Remote):
        source.forget()
    return unreadable(source, error)


def lost(file: Remote | str, error: Exception | str) -> CorruptError:
    """The error for an object that is gone, or not the one that was registered."""
    told = "No such file or directory" if isinstance(error, FileNotFoundError) else str(error)
    return CorruptError(
        f"{str(file)!r} cannot be read: {told}",
        expected="the file as it was registered",
        do="run `dynreg verify --repair` to see what is lost and what can be rebuilt",
    )


def _absent(uri: str) -> NoPlaceError:
    return NoPlaceError(
        f"there is no bucket at {uri.partition('?')[0]!r}",
        expected="a bucket that is there; dynreg makes none",
        do="make it, or name another one",
    )


def _brief(text: str) -> str:
    """What an error of pyarrow's says, without the request that it repeats."""
    return text.replace("When ", "").partition(" Detail:")[0][:200]


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


def _reached(uri: str) -> tuple["FileSystem", str]:
    """The file system of an address, and the path in it; UsageError for an odd address, or one with a key in it."""
    from pyarrow.fs import AwsStandardS3RetryStrategy, FileSystem, S3FileSystem

    parts = urlsplit(uri)
    told = dict(parse_qsl(parts.query))
    if parts.username or parts.password or _SECRET & set(told):
        raise UsageError(
            "the address of the bucket holds a key, which would be stored in a file",
            expected="an address without it, such as s3://BUCKET/PREFIX",
            do="keep keys in AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or in ~/.aws",
        )
    odd = set(told) - _OPTIONS if parts.scheme == "s3" else set()
    if not parts.scheme or odd or (parts.scheme == "s3" and not parts.netloc):
        raise UsageError(
            f"{uri.partition('?')[0]!r} is no address of a bucket" + (f": {min(odd)!r}" if odd else ""),
            expected=f"s3://BUCKET/PREFIX, with {', '.join(sorted(_OPTIONS))} behind a '?' where they are needed",
            do="give another address",
        )
    if parts.scheme != "s3":
        try:
            return FileSystem.from_uri(uri)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"{uri.partition('?')[0]!r} cannot be opened: {_brief(str(error))}",
                expected="s3://BUCKET/PREFIX",
                do="give an address that pyarrow.fs reaches",
            ) from error
    retries = AwsStandardS3RetryStrategy(max_attempts=_ATTEMPTS)
    limits = {"connect_timeout": _CONNECT_SECONDS, "request_timeout": _REQUEST_SECONDS}
    how = {"background_writes": False, "allow_delayed_open": True}  # a small object goes in one request
    files = S3FileSystem(**told, **limits, **how, retry_strategy=retries)
    return files, f"{parts.netloc}{parts.path}".rstrip("/")
