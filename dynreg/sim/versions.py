"""The versions of what simulates a robot: what they computed is computed again where they are others."""

from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version


def versions() -> dict[str, str]:
    """Of dynreg and MuJoCo, where they are installed and not just a folder on the path."""
    found = {}
    for name in ("dynreg", "mujoco"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
