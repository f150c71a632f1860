"""A small registry with something of each kind, and copies of it: in a folder, or on servers."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from flips import make, make_shared
from stores import Stores

from dynreg.registry import Registry
from dynreg.registry.files import CACHE, SEARCHES
from dynreg.registry.sharing import shared_at


@dataclass(frozen=True)
class Sound:
    """Where it lies. stores : the servers of a shared one; None of one in a folder."""

    path: Path
    stores: Stores | None = None

    @contextmanager
    def copied(self, to: Path) -> Iterator[Path]:
        """A copy of all of it, to be damaged, whose folder is `to`; it goes with the block."""
        if self.stores is None:
            shutil.copytree(self.path, to)
            yield to
        else:
            name = self.stores.new(like=database_of(self.path))
            Registry.share(to, self.stores.catalog(name), self.stores.blobs(name)).close()
            for kept in (CACHE, SEARCHES):
                shutil.copytree(self.path / kept, to / kept, dirs_exist_ok=True)
            yield to
            self.stores.drop(name)
        shutil.rmtree(to)


def sound_in(folder: Path, stores: Stores | None) -> Sound:
    """Make it, on these servers where there are some."""
    if stores is None:
        return Sound(make(folder))
    name = stores.new()
    return Sound(make_shared(folder / "registry", stores.catalog(name), stores.blobs(name)), stores)


def database_of(path: Path) -> str:
    """The name of a shared registry's database."""
    return shared_at(path).catalog.rpartition("/")[2]
