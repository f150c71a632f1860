"""Versions, the machine, and what a registry holds."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from dynreg.registry import Registry
from dynreg.results.stored import Info
from dynreg.verbs.list import KINDS, listing

NEEDED = ("dynreg", "mujoco", "torch", "numpy", "pyarrow")
OPTIONAL = {
    "hnswlib": "hnswlib",
    "psycopg": "postgres",
    "rerun-sdk": "rerun",
}  # distribution: the extra that brings it


def information(registry: Registry | Path) -> Info:
    """Versions, machine, and counts of what an open registry holds; of a path, where no registry is, only the rest."""
    opened = registry if isinstance(registry, Registry) else None
    return Info(
        registry=str(registry if opened is None else opened.path),
        exists=opened is not None,
        holds={} if opened is None else _holds(opened),
        entries=0 if opened is None else sum(opened.count(p.id) for p in opened.populations()),
        **({} if opened is None else opened.addresses),
        versions={"python": platform.python_version()} | {name: version(name) for name in NEEDED},
        optional={name: _version(name) for name in OPTIONAL},
        system=platform.platform(),
        device=_device(),
        cores=os.cpu_count() or 1,
    )


def _holds(registry: Registry) -> dict[str, int]:
    listed = listing(registry)
    return {kind: sum(i.kind == kind for i in listed.items) for kind in KINDS}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _device() -> str:
    import torch

    return torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"
