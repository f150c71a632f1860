"""Files that survive a crash: written under a temporary name, synced, renamed; named by what they hold."""

import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.errors import CorruptError, RegistryError

FOLDERS = ("shards", "populations", "recordings", "robots", "simulators", "results", "index")
ROBOTS = "robots"
LOCKS = "locks"
CACHE = "cache"  # what can be computed again; the catalogue knows nothing of it
SEARCHES = "searches"  # journals of searches that have not ended
LOST_AND_FOUND = "lost+found"
_TEMPORARY = ".tmp-"


@dataclass(frozen=True)
class StoredFile:
    """One file as the catalogue knows it: path relative to the registry, sha256, size in bytes."""

    path: str
    sha256: str
    size: int


def content_name(folder: str, stem: str, data: bytes, suffix: str) -> StoredFile:
    """The name under which `data` is stored: it ends in the data's own hash, so no two contents meet."""
    digest = hashlib.sha256(data).hexdigest()
    return StoredFile(f"{folder}/{stem}-{digest[:16]}.{suffix}", digest, len(data))


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, 64 hexadecimal digits."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_file(path: Path, data: bytes) -> None:
    """Put `data` at `path` so that a reader or a crash sees all of it or nothing.

    Raises RegistryError when the place cannot be written.
    """
    try:
        while not _write_once(path, data):
            pass
    except OSError as error:
        raise RegistryError(
            f"cannot write {str(path)!r}: {error.strerror or error}",
            expected="a writable directory with room left",
            do="free some space or mend its permissions, then run the same command again",
        ) from error


def sync_folder(folder: Path) -> None:
    """Make the renames done in `folder` last through a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def temporary_name(path: Path) -> Path:
    """A hidden name beside `path` that no other writer uses."""
    return path.with_name(f".{path.name}{_TEMPORARY}{secrets.token_hex(6)}")


def is_temporary(name: str) -> bool:
    """True for the names that `temporary_name` gives."""
    return name.startswith(".") and _TEMPORARY in name


def sweep(root: Path) -> int:
    """Remove the temporary files of writers that are gone; returns how many.

    A living writer holds a lock on its file, so its work is left alone.
    """
    swept = 0
    found = [*root.glob(f".*{_TEMPORARY}*")]
    for folder in (*FOLDERS, CACHE):
        found += (root / folder).rglob(f".*{_TEMPORARY}*")
    for path in found:
        with try_lock(path, create=False) as mine:
            if mine:
                path.unlink(missing_ok=True)
                swept += 1
    return swept


@contextmanager
def try_lock(path: Path, create: bool = True) -> Iterator[bool]:
    """Hold the lock of a file for the block; False where another process holds it.

    The operating system lets the lock go when its process ends, however it ends.
    """
    flags = os.O_RDWR | (os.O_CREAT if create else 0)
    try:
        descriptor = os.open(path, flags, 0o644)
    except FileNotFoundError:
        yield False
        return
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
            return
        # The holder before us may have removed the name between our open and our lock.
        yield _same_file(descriptor, path)
    finally:
        os.close(descriptor)


def encode_arrays(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> bytes:
    """Safetensors bytes of named arrays with a JSON header; the same arrays give the same bytes."""
    from safetensors.numpy import save

    # One metadata key: safetensors writes several in no fixed order.
    tensors = {name: np.ascontiguousarray(arrays[name]) for name in sorted(arrays)}
    return save(tensors, metadata={"dynreg": canonical_json(header)})


def decode_arrays(path: Path, skip: str = "/") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a safetensors file, without those whose name starts with `skip`.

    Raises CorruptError when the file is missing or not what `encode_arrays` writes.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), framework="numpy") as stream:
            header = json.loads(stream.metadata()["dynreg"])
            return header, {key: stream.get_tensor(key) for key in stream.keys() if not key.startswith(skip)}
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise unreadable(path, error) from error


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


def unreadable(path: Path, error: Exception | str) -> CorruptError:
    """The error for a stored file that cannot be read."""
    return CorruptError(
        f"{str(path)!r} cannot be read: {error}",
        expected="the file as it was registered",
        do="run `dynreg verify --repair` to see what is lost and what can be rebuilt",
    )


def _write_once(path: Path, data: bytes) -> bool:
    temporary = temporary_name(path)
    with open(temporary, "xb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX)
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
            os.replace(temporary, path)
        except FileNotFoundError:
            return False  # swept in the instant between its creation and its lock
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    sync_folder(path.parent)
    return True


def _same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")
