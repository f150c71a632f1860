"""Versions, device and counts."""

import os
from importlib.metadata import version
from typing import Any

from dynreg.registry import Registry
from dynreg.verbs.list import KINDS, listing


def information(registry: Registry) -> dict[str, Any]:
    """Versions, device, cores, and counts of what the registry holds."""
    import torch

    listed = listing(registry)
    counts = {kind: sum(i.kind == kind for i in listed.items) for kind in KINDS}
    packages = {name: version(name) for name in ("dynreg", "mujoco", "torch", "numpy", "pyarrow")}
    return {
        "schema": "dynreg/info/1",
        "registry": str(registry.path),
        "holds": counts,
        "entries": sum(registry.count(p.id) for p in registry.populations()),
        "versions": packages,
        "device": torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu",
        "cores": os.cpu_count(),
    }
