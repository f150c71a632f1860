"""The bytes of the registry's files: named arrays with a header, and JSON in the one form that is hashed."""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.errors import RegistryError
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


def decode_arrays(path: Path, skip: str = "/") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a safetensors file, without those whose name starts with `skip`.

    Raises CorruptError when the file is missing or not what `encode_arrays` writes.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), framework="numpy") as stream:
            header = json.loads(stream.metadata()["dynreg"])
            arrays = {key: stream.get_tensor(key) for key in stream.keys() if not key.startswith(skip)}
            return _object(header), arrays
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from error


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
