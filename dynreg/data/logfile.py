"""A log to read: a file on disk, or named bytes in memory."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from dynreg.errors import LogError


@dataclass(frozen=True)
class LogFile:
    """One file, or folder, that is read as a log.

    path : where it is; for bytes in memory the name that they go by, whose suffix may tell the format.
    data : the bytes, None where they are on disk.
    """

    path: Path
    data: bytes | None = None

    @classmethod
    def of(cls, source: "str | Path | LogFile") -> "LogFile":
        """A path as a LogFile."""
        return source if isinstance(source, LogFile) else cls(Path(source))

    @property
    def name(self) -> str:
        """What errors and findings call it."""
        return self.path.name

    @property
    def stem(self) -> str:
        """The name without its suffix; a folder's name is whole, whatever dots are in it."""
        return self.name if self.folder is not None else self.path.stem

    @property
    def size(self) -> int:
        """Bytes."""
        return len(self.data) if self.data is not None else self.path.stat().st_size

    @property
    def folder(self) -> Path | None:
        """The folder, where it is one."""
        return self.path if self.data is None and self.path.is_dir() else None

    def open(self) -> BinaryIO:
        """A stream of its bytes.

        Raises LogError where there is no such file, it may not be read, or it is none (a pipe would never end).
        """
        if self.data is not None:
            return BytesIO(self.data)
        if not self.path.exists():
            raise LogError(
                f"there is no log {str(self.path)!r}", expected="an existing file", do="check the path"
            )
        if not self.path.is_file():
            raise LogError(
                f"{self.name!r} is neither a file nor a folder",
                expected="a log that was recorded to its end",
                do="write it to a file first",
            )
        try:
            return self.path.open("rb")
        except OSError as error:
            raise LogError(
                f"{self.name!r} cannot be opened: {error.strerror}",
                expected="a readable file",
                do="check its permissions",
            ) from error

    def read(self) -> bytes:
        """All of its bytes."""
        with self.open() as stream:
            return stream.read()

    @contextmanager
    def on_disk(self) -> Iterator[Path]:
        """A path that holds the bytes, for libraries that read nothing else; one of its own goes at the end."""
        if self.data is None:
            yield self.path
            return
        with TemporaryDirectory(prefix="dynreg-") as folder:
            path = Path(folder) / (self.name or "log")
            path.write_bytes(self.data)
            yield path
