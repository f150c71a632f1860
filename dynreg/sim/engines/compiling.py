"""The joint engine's kernel: written out for the effects that are asked for, compiled by numba, and kept on disk.

One kernel holds all effects of the table, and the noise of hidden robots, so that one compilation (8 s) serves every
robot; other effects make another. The hash of the text, with the versions of what compiles it and the processor, names
its folder in `dynreg/kernels/` below the user's cache (XDG_CACHE_HOME, else ~/.cache), where numba keeps the machine
code beside it. Where nothing can be written, or others may write, it is compiled in memory.
"""

import hashlib
import os
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib import import_module
from importlib.abc import ExecutionLoader
from importlib.metadata import version
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from shutil import rmtree
from tempfile import NamedTemporaryFile
from types import ModuleType

from dynreg.errors import SimulationError
from dynreg.sim.effects import effects
from dynreg.sim.effects.disturbance import Disturbance
from dynreg.sim.engines import joint_kernel
from dynreg.sim.engines.tracing import PORTS, Traced, traced, traced_law

_DISTURBANCE = Disturbance()
_ARGUMENTS = "x, kinds, places, n, first, commands, sims, drives, step, substep, trail"
# No reordering of sums and no fused products: the same numbers as one operation after the other, on every processor.
_HEAD = """
from numba import njit, types

_plain = njit(error_model="numpy", boundscheck=False)
_read, _written = types.Array(types.float64, 3, "A", readonly=True), types.float64[:, :, ::1]
_signature = types.void(
    types.int64[:, ::1], types.int64[::1], types.int64[:, ::1], types.int64[::1], types.int64[::1],
    types.float64, types.float64[:, ::1], types.float64[:, ::1], _read, types.int64[:, ::1], types.float64[:, :, ::1],
    _read, _written, _written,
)
"""
_TAIL = """
sine, exponential, ago = _plain(sine), _plain(exponential), _plain(ago)
obey, listen, press, remember = _plain(obey), _plain(listen), _plain(press), _plain(remember)
turn, advance = _plain(turn), _plain(advance)
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
    numba, text = _numba(), source(kinds)
    try:
        return _run(text)
    except numba.core.errors.NumbaError as problem:
        raise SimulationError(
            f"the effects of this batch cannot be compiled for the joint engine: {str(problem).splitlines()[0]}",
            expected="functions of numpy that numba knows, too",
            do="write the ports with those, or run the robot on the mujoco engine",
        ) from problem


def _numba() -> ModuleType:
    """numba; unless it is loaded already, without Intel's vector library.

    What that says of a cosine or of a plugin's np.tanh depends on where in a vector a number stands: a joint alone
    would end in other bits than beside others. numba reads the variable when it is loaded, and never again.
    """
    if (off := "NUMBA_DISABLE_INTEL_SVML") in os.environ:
        return import_module("numba")
    os.environ[off] = "1"
    try:
        return import_module("numba")
    finally:
        del os.environ[off]


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


def _run(text: str) -> Callable:
    """`run` of a text: from its folder in the user's cache, else compiled in memory."""
    try:
        path = _written(text)
        return _loaded(_Text(text, str(path)), f"dynreg_kernel_{path.parent.name}").run
    except (OSError, RuntimeError):  # nowhere to write; numba's own for that is the second
        pass
    except _numba().core.errors.NumbaError:
        raise
    except Exception:  # damaged machine code, of whatever kind: the next process writes it anew
        rmtree(path.with_name("__pycache__"), ignore_errors=True)
    return _loaded(_Text(text.replace("cache=True", "cache=False"), "dynreg_kernel"), "dynreg_kernel").run


def _written(text: str) -> Path:
    """Where a text lies in the user's cache; written unless it is there.

    A folder of its own for each processor: numba tells their machine code apart, too, but two processes that first
    compile at once name its files alike. Raises OSError where nothing can be written, or where others may write: what
    lies there runs.
    """
    numba = _numba()
    versions = [*(version(name) for name in ("numba", "llvmlite", "numpy")), sys.version]
    processor = [*numba.core.registry.cpu_target.target_context.codegen().magic_tuple()]
    unlike = [text, *versions, *processor, str(numba.config.USING_SVML)]
    digest = hashlib.sha256("\n".join(unlike).encode()).hexdigest()
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = root / "dynreg" / "kernels" / digest[:32] / "joint.py"
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    if os.name == "posix":
        place = path.parent.stat()
        if place.st_uid != os.getuid() or place.st_mode & 0o022:
            raise PermissionError(f"others may write to {path.parent}")
    if not path.exists() or path.read_bytes() != text.encode():
        with NamedTemporaryFile("wb", dir=path.parent, suffix=".new", delete=False) as file:
            file.write(text.encode())
        os.utime(file.name, (0, 0))  # numba asks when the text was written: two processes write the same
        os.replace(file.name, path)
    return path


def _loaded(text: "_Text", name: str) -> ModuleType:
    spec = spec_from_loader(name, text)
    module = sys.modules[name] = module_from_spec(spec)  # numba looks for it by its name
    spec.loader.exec_module(module)
    return module


class _Text(ExecutionLoader):
    """A module of a text, whatever the file says by now beside which numba keeps the machine code."""

    def __init__(self, text: str, path: str):
        self._text, self._path = text, path

    def get_source(self, fullname: str) -> str:
        return self._text

    def get_filename(self, fullname: str) -> str:
        return self._path
