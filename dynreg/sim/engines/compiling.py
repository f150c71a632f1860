"""The joint engine's kernel: written out for the effects that are asked for, compiled by numba, and kept on disk.

One kernel holds all effects of the table, and the noise of hidden robots, so that one compilation (8 s) serves every
robot; other effects make another. The hash of the text, with the versions of what compiles it, names its folder
`dynreg/kernels/` below the user's cache (XDG_CACHE_HOME, else ~/.cache), where numba keeps the machine code beside it,
for each processor. Where nothing can be written, it is compiled in memory.
"""

import hashlib
import os
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib.abc import InspectLoader
from importlib.metadata import version
from importlib.util import module_from_spec, spec_from_file_location, spec_from_loader
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import ModuleType

from dynreg.errors import SimulationError
from dynreg.sim.effects import effects
from dynreg.sim.effects.disturbance import Disturbance
from dynreg.sim.engines import joint_kernel
from dynreg.sim.engines.tracing import PORTS, Traced, traced, traced_law

_DISTURBANCE = Disturbance()
_ARGUMENTS = "x, kinds, places, n, first, commands, sims, drives, step, substep"
# No reordering of sums and no fused products: the same numbers as one operation after the other, on every processor.
_HEAD = """
from numba import njit, types

_plain = njit(error_model="numpy", boundscheck=False)
_read, _written = types.Array(types.float64, 3, "A", readonly=True), types.float64[:, :, ::1]
_signature = types.void(
    types.int64[:, ::1], types.int64[::1], types.int64[:, ::1], types.int64[::1], types.float64[:, ::1],
    types.float64[:, ::1], _read, types.int64[:, ::1], types.float64[:, :, ::1], _read, _written, _written,
)
"""
_TAIL = """
sine, exponential = _plain(sine), _plain(exponential)
obey, listen, advance = _plain(obey), _plain(listen), _plain(advance)
run = njit(_signature, nogil=True, cache={cache}, error_model="numpy", boundscheck=False)(run)
"""


def kernel(needed: Sequence[Traced]) -> tuple[Callable, dict[Traced, int]]:
    """`joint_kernel.run` compiled, and the number of each effect's kind in it."""
    table = _table()
    kinds = (*table, *sorted({*needed} - {*table}, key=repr))
    return _compiled(kinds), {one: number for number, one in enumerate(kinds)}


@lru_cache(maxsize=1)
def _of(every: tuple) -> tuple[Traced, ...]:
    found: dict[Traced, None] = {}
    for effect in every:
        try:
            made = traced(effect)
        except SimulationError:  # not one for joints; told when it is asked for
            continue
        if made.bodies:
            found[made] = None
    return tuple(found)


def _table() -> tuple[Traced, ...]:
    return _of((*effects().values(), _DISTURBANCE))


@lru_cache(maxsize=16)
def _compiled(kinds: tuple[Traced, ...]) -> Callable:
    os.environ.setdefault(
        "NUMBA_DISABLE_INTEL_SVML", "1"
    )  # its sine depends on where in a vector a number stands
    text = source(kinds)
    try:
        return _stored(text).run
    except Exception:  # nowhere to write, or what lies there is damaged; else it fails once more
        pass
    try:
        return _in_memory(text).run
    except Exception as problem:  # numba's own
        raise SimulationError(
            f"the effects of this batch cannot be compiled for the joint engine: {str(problem).splitlines()[0]}",
            expected="functions of numpy that numba knows, too",
            do="write the ports with those, or run the robot on the mujoco engine",
        ) from problem


def source(kinds: Sequence[Traced]) -> str:
    """The text of the module; the same for the same kinds."""
    parts = [Path(joint_kernel.__file__).read_text(encoding="utf-8"), _HEAD]
    parts.append("@_plain\ndef law(x, n):\n    for k in range(n):\n" + _block(traced_law(), 8))
    for port in PORTS:
        acting = [(i, *body[1:]) for i, one in enumerate(kinds) for body in one.bodies if body[0] == port]
        parts += [_function(port, *one) for one in acting]
        parts.append(_dispatch(port, [one[0] for one in acting]))
    return "\n\n".join(parts) + _TAIL.format(cache=True)


def _function(port: str, number: int, first: Sequence[str], later: Sequence[str]) -> str:
    lines = [f"@_plain\ndef {port}_{number}({_ARGUMENTS.replace('kinds, places', 'own')}):"]
    if first == later:
        return "\n".join([*lines, "    for k in range(n):", _block(later, 8)])
    told = ["    if first:", "        for k in range(n):", _block(first, 12)]
    return "\n".join([*lines, *told, "    else:", "        for k in range(n):", _block(later, 12)])


def _dispatch(port: str, numbers: Sequence[int]) -> str:
    call = _ARGUMENTS.replace("kinds, places", "x[places[j] :]")
    lines = [
        f"@_plain\ndef {port}({_ARGUMENTS}):",
        "    for j in range(len(kinds)):",
        "        kind = kinds[j]",
    ]
    for number in numbers:
        lines += [f"        if kind == {number}:", f"            {port}_{number}({call})"]
    return "\n".join(lines)


def _block(lines: Sequence[str], indent: int) -> str:
    return "\n".join(" " * indent + line for line in lines) + "\n"


def _stored(text: str) -> ModuleType:
    """The module of a text, from its folder in the user's cache."""
    versions = [*(version(name) for name in ("numba", "llvmlite", "numpy")), sys.version]
    digest = hashlib.sha256("\n".join([text, *versions]).encode()).hexdigest()
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = root / "dynreg" / "kernels" / digest[:32] / "joint.py"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile("w", dir=path.parent, suffix=".new", encoding="utf-8", delete=False) as file:
            file.write(text)
        os.utime(file.name, (0, 0))  # numba asks when the text was written: two processes write the same
        os.replace(file.name, path)
    return _loaded(spec_from_file_location(f"dynreg_kernel_{digest[:8]}", path))


def _in_memory(text: str) -> ModuleType:
    return _loaded(spec_from_loader("dynreg_kernel", _Text(text.replace("cache=True", "cache=False"))))


def _loaded(spec) -> ModuleType:
    module = sys.modules[spec.name] = module_from_spec(spec)  # numba looks for it by its name
    spec.loader.exec_module(module)
    return module


class _Text(InspectLoader):
    """A module of a text that is in no file."""

    def __init__(self, text: str):
        self._text = text

    def get_source(self, fullname: str) -> str:
        return self._text
