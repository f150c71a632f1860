"""Where inputs lie while they are read: in a folder in memory, one file a name, written over by the next."""

import atexit
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

_MEMORY = Path("/dev/shm")


def held(name: str, data: bytes | None) -> Path:
    """The path of a file of this name that holds `data`; None leaves it as it is."""
    path = folder(os.getpid()) / name
    if data is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return path


@cache
def folder(process: int) -> Path:
    """The folder of one process, gone when it ends as it should."""
    made = Path(tempfile.mkdtemp(prefix=f"inputs-{process}-", dir=_MEMORY if _MEMORY.is_dir() else None))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def clear(process: int) -> None:
    """Remove what a process left that did not end as it should."""
    for left in Path(_MEMORY if _MEMORY.is_dir() else tempfile.gettempdir()).glob(f"inputs-{process}-*"):
        shutil.rmtree(left, ignore_errors=True)
