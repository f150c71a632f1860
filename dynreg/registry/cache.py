"""A cache of computed things by key, in files of their own that the catalogue does not know.

A file holds its key, its document and the hash of both, so that a torn or damaged one is seen and counts as not there.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dynreg.registry.disk as disk
from dynreg.errors import RegistryError
from dynreg.registry.codec import strict_json
from dynreg.registry.directory import Directory
from dynreg.registry.files import CACHE, content_hash, is_content, read_regular, write_file

ROBOT_CHECK = "robot_check"  # the kind of what a check of a robot tells: it takes seconds


def put_cached(directory: Directory, kind: str, key: Mapping[str, Any], document: Mapping[str, Any]) -> None:
    """Keep `document` under `key` (both plain JSON), in place of what stood there; RegistryError where it cannot."""
    path = directory.home / _name(kind, key)
    disk.make_folder(path.parent)
    content = {"key": dict(key), "document": dict(document)}
    write_file(path, strict_json(content | {"sha256": _hash(content)}))


def get_cached(directory: Directory, kind: str, key: Mapping[str, Any]) -> dict[str, Any] | None:
    """What was kept under `key`; None where there is nothing or its file is damaged."""
    try:
        stored = json.loads(read_regular(_found(directory, kind, key)))
        sound = stored["sha256"] == _hash({"key": dict(key), "document": stored["document"]})
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return stored["document"] if sound else None


def goes_on(home: Path) -> bool:
    """Whether the cache of the registry at `home` holds what took long, as the trials of an interrupted command."""
    return any(
        is_content(path.name) and path.parent.name != ROBOT_CHECK for path in (home / CACHE).glob("*/*")
    )


def is_sound(path: Path) -> bool:
    """Whether a file of the cache holds what was kept, under the name of its key."""
    try:
        stored = json.loads(read_regular(path))
        content = {"key": stored["key"], "document": stored["document"]}
        return stored["sha256"] == _hash(content) and path.stem == _hash(stored["key"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError, RegistryError):
        return False


def _found(directory: Directory, kind: str, key: Mapping[str, Any]) -> Path:
    put_here = directory.home / _name(kind, key)
    return put_here if put_here.exists() else directory.path / _name(kind, key)


def _name(kind: str, key: Mapping[str, Any]) -> Path:
    return Path(CACHE) / kind / f"{_hash(key)}.json"


def _hash(document: Mapping[str, Any]) -> str:
    return content_hash(strict_json(document))
