"""Text that numba compiles, kept on disk with its machine code.

The hash of the text, with the versions of what compiles it and the processor, names its folder in `dynreg/kernels/`
below the user's cache (XDG_CACHE_HOME, else ~/.cache), where numba keeps the machine code beside it: a text that
changed anywhere is compiled anew. Where nothing can be written, or others may write, it is compiled in memory.
"""

import hashlib
import os
import sys
from importlib import import_module
from importlib.abc import ExecutionLoader
from importlib.metadata import version
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from shutil import rmtree
from tempfile import NamedTemporaryFile
from types import ModuleType


def numba() -> ModuleType:
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


def compiled(text: str, name: str) -> ModuleType:
    """The module of a text: from its folder in the user's cache, else compiled in memory.

    The text has `cache=True` in the decorators of what is to be kept. name : of its file.
    """
    loaded = numba()
    try:
        path = _written(text, name)
        return _loaded(_Text(text, str(path)), f"dynreg_kernel_{path.parent.name}")
    except (OSError, RuntimeError):  # nowhere to write; numba's own for that is the second
        pass
    except loaded.core.errors.NumbaError:
        raise
    except Exception:  # damaged machine code, of whatever kind: the next process writes it anew
        rmtree(path.with_name("__pycache__"), ignore_errors=True)
    in_memory = f"dynreg_kernel_{name}"
    return _loaded(_Text(text.replace("cache=True", "cache=False"), in_memory), in_memory)


def _written(text: str, name: str) -> Path:
    """Where a text lies in the user's cache; written unless it is there.

    A folder of its own for each processor: numba tells their machine code apart, too, but two processes that first
    compile at once name its files alike. Raises OSError where nothing can be written, or where others may write: what
    lies there runs.
    """
    numba_ = numba()
    versions = [*(version(name) for name in ("numba", "llvmlite", "numpy")), sys.version]
    processor = [*numba_.core.registry.cpu_target.target_context.codegen().magic_tuple()]
    unlike = [text, *versions, *processor, str(numba_.config.USING_SVML)]
    digest = hashlib.sha256("\n".join(unlike).encode()).hexdigest()
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = root / "dynreg" / "kernels" / digest[:32] / f"{name}.py"
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
