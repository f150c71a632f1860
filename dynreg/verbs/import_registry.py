"""Import: everything that another registry holds, by content."""

from pathlib import Path

from dynreg.progress import Progress
from dynreg.registry import Registry, open_source, take_in
from dynreg.results.stored import Import


def import_registry(registry: Registry, path: Path, progress: Progress | None = None) -> Import:
    """Take everything in the registry at `path` into `registry`; that one stays as it is.

    Raises as `registry.take_in`, and RegistryError where there is no registry at `path`.
    """
    with open_source(path) as source:
        brought = take_in(registry, source, progress or (lambda *_: None))
    return Import(registry=str(registry.path), source=str(path), **vars(brought))
