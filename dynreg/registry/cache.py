"""What can be computed again, kept by key: files of their own, of which the catalogue knows nothing.

A file holds its key, its document and the hash of both, so that a torn or damaged one is seen and counts as not there.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dynreg.registry.directory import Directory
from dynreg.registry.files import CACHE, strict_json, write_file


def put_cached(directory: Directory, kind: str, key: Mapping[str, Any], document: Mapping[str, Any]) -> None:
    """Keep `document` under `key` (both plain JSON), in place of what stood there; RegistryError where it cannot."""
    directory.catalog.check_writable()
    path = _path(directory, kind, key)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"key": dict(key), "document": dict(document)}
    write_file(path, strict_json(content | {"sha256": _hash(content)}))


def get_cached(directory: Directory, kind: str, key: Mapping[str, Any]) -> dict[str, Any] | None:
    """What was kept under `key`; None where there is nothing or its file is damaged."""
    try:
        stored = json.loads(_path(directory, kind, key).read_bytes())
        sound = stored["sha256"] == _hash({"key": dict(key), "document": stored["document"]})
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return stored["document"] if sound else None


def _path(directory: Directory, kind: str, key: Mapping[str, Any]) -> Path:
    return directory.path / CACHE / kind / f"{_hash(key)}.json"


def _hash(document: Mapping[str, Any]) -> str:
    return hashlib.sha256(strict_json(document)).hexdigest()
