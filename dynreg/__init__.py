"""dynreg: a dataset-and-model registry for robot dynamics.

>>> import dynreg
>>> reg = dynreg.open("my-registry")                                   # doctest: +SKIP
>>> reg.populate("servo_pendulum", n=1000)                             # doctest: +SKIP
>>> recording = reg.ingest("run.mcap", robot="servo_pendulum")         # doctest: +SKIP
>>> reg.query(recording, k=5)                                          # doctest: +SKIP
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynreg.data.recording import Channel, Episode, Recording
    from dynreg.errors import DynregError
    from dynreg.session import Session, open, share

    __version__: str

# names are imported when they are first used, so that `import dynreg` stays quick
_HOMES = {
    "Channel": "dynreg.data.recording",
    "DynregError": "dynreg.errors",
    "Episode": "dynreg.data.recording",
    "Recording": "dynreg.data.recording",
    "Session": "dynreg.session",
    "check_robot": "dynreg.sim.inspection",
    "load_robot": "dynreg.sim.robot",
    "open": "dynreg.session",
    "packaged_robots": "dynreg.sim.robot",
    "read_recording": "dynreg.data.ingest",
    "share": "dynreg.session",
}

__all__ = [*_HOMES, "__version__"]  # noqa: PLE0604


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("dynreg")
    except PackageNotFoundError:  # run from a source tree that was never installed
        return "0"


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name not in _HOMES:
        raise AttributeError(f"module 'dynreg' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
