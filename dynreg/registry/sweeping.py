"""Files that go for good: removed with their names synced, and the folders that they leave empty."""

from collections.abc import Iterable
from pathlib import Path

import dynreg.registry.disk as disk


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files of a folder; 0 where there is none."""
    if path.is_symlink() or not path.exists():
        return 0
    files = (p for p in path.rglob("*") if p.is_file() and not p.is_symlink()) if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files)


def remove_files(root: Path, names: Iterable[str]) -> None:
    """Remove files, and whole folders where a name ends in "/"; links are removed and never followed.

    names : paths below `root`. What is gone already is no error.
    """
    touched = set()
    for name in names:
        path = root / name
        if path.is_dir() and not path.is_symlink():
            touched.add(path.parent)
            _remove_folder(path)
        elif path.is_symlink() or path.exists():
            disk.remove(path)
            touched.add(path.parent)
    for folder in sorted(touched):
        if folder.is_dir():
            disk.sync_folder(folder)


def _remove_folder(folder: Path) -> None:
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.is_symlink():
            _remove_folder(path)
        else:
            disk.remove(path)
    disk.remove_folder(folder)
