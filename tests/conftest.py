"""What all tests share: the folder of measured data, fixed seeds, drawing without a screen, snapshots."""

import gc
import hashlib
import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import stores as stores_
from hypothesis import settings

ROOT = Path(__file__).parents[1]

os.environ.setdefault("MPLBACKEND", "Agg")  # for subprocesses too; read when matplotlib is first imported

# the same examples in every run, and no deadline: the machine may be busy
settings.register_profile("dynreg", deadline=None, derandomize=True, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "dynreg"))


LONGEST = ("test_pages.py", "test_wheel.py", "test_optional_parts.py", "test_examples.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first: where several processes share the tests, none is left with one of them at the end."""
    items.sort(key=lambda item: item.path.name not in LONGEST)


def pytest_collection_finish() -> None:
    """What is imported by now stays: the collector, which took a tenth of the time, need not look at it again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 10)  # rarer still costs GB of what nobody holds any more


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where the registries of `tests/registry` lie: in a folder, or on servers that the tests start."""
    parser.addoption("--store", choices=("folder", "shared"), default="folder", help=pytest_addoption.__doc__)


@pytest.fixture(scope="session")
def stores() -> Iterator[stores_.Stores]:
    """PostgreSQL and a stand-in for S3, running; the tests that ask for them are skipped where they cannot run."""
    if why := stores_.why_none():
        pytest.skip(why)
    with stores_.running() as running:
        yield running


@pytest.fixture(autouse=True)
def _fixed_seeds() -> None:
    """The sources of chance that dynreg does not use itself; a library may."""
    random.seed(0)
    np.random.seed(0)  # noqa: NPY002


@pytest.fixture(scope="module", autouse=True)
def syncing() -> Iterator[None]:
    """`os.fsync` does nothing: it takes a tenth of the tests' time, and only `tests/registry` cuts the power."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of measured data (`DYNREG_DATA_DIR`, or shared/data beside the repository)."""
    folder = Path(os.environ.get("DYNREG_DATA_DIR", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no measured data: set DYNREG_DATA_DIR to a folder with copies of it")
    return folder


@pytest.fixture(scope="session")
def registry_snapshot() -> Callable[[Path], dict[str, str]]:
    """Path of every file below a folder to the SHA-256 of its bytes: two equal ones hold the same data.

    SQLite's journals and the lock files are left out: they tell of who is at work, not of what is stored.
    """

    def snapshot(folder: Path) -> dict[str, str]:
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        passing = ("-wal", "-shm", "-journal", ".lock")
        return {
            path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in files
            if not path.name.endswith(passing)
        }

    return snapshot


@pytest.fixture(scope="session")
def registry_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tiny registry of the servo bench, made once; work on copies of it."""
    import tiny_registry

    return tiny_registry.make(tmp_path_factory.mktemp("tiny"))
