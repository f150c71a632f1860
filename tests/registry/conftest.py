"""A small registry: one robot, a population of 10 entries in shards of 4, one recording."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from about_a_folder import about_a_folder
from registry_contents import ROBOT, fill, make_measured, make_recording, make_robot

from dynreg.registry import Registry


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With `--store shared`, the tests that are about a folder's own files are skipped, each with its reason."""
    if config.getoption("--store") == "shared":
        for item in items:
            if why := about_a_folder(item.path.name, getattr(item, "originalname", item.name)):
                item.add_marker(pytest.mark.skip(reason=why))


@pytest.fixture(scope="module", autouse=True)
def syncing() -> None:
    """The power may go here at any moment, so `os.fsync` does what it does on any machine."""


@pytest.fixture
def path(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    """Where a new registry can be opened; with `--store shared`, the local folder of an empty one on the servers."""
    if request.config.getoption("--store") == "folder":
        yield tmp_path / "registry"
        return
    stores = request.getfixturevalue("stores")
    name = stores.new()
    Registry.share(tmp_path / "registry", stores.catalog(name), stores.blobs(name)).close()
    yield tmp_path / "registry"
    stores.drop(name)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return make_robot(tmp_path / "robot")


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small registry, made once; tests work on copies of it."""
    folder = tmp_path_factory.mktemp("filled")
    with Registry.open(folder / "registry", create=True) as registry:
        _fill(registry, folder)
    return folder / "registry"


@pytest.fixture(scope="session")
def filled_shared(stores, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same on the servers, by the name of its database and bucket."""
    folder, name = tmp_path_factory.mktemp("filled_shared"), stores.new()
    with Registry.share(folder / "registry", stores.catalog(name), stores.blobs(name)) as registry:
        _fill(registry, folder)
    return name


def _fill(registry: Registry, folder: Path) -> None:
    fill(registry, make_robot(folder / "robot"))
    recording = registry.put_recording(make_recording(1), ROBOT, "first run")
    registry.put_measured(make_measured(recording))
    registry.put_result("neighbours", recording, {"k": 5})
    registry.put_simulator({"robot": ROBOT, "values": {"mass": 1.5}})
    registry.put_index("bench", "landmarks", {"losses": registry.load("bench").values})


@pytest.fixture
def registry(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Registry]:
    """A copy of the small registry, open: in a folder, or on the servers with `--store shared`."""
    if request.config.getoption("--store") == "shared":
        yield request.getfixturevalue("shared")
        return
    path = request.getfixturevalue("path")
    shutil.copytree(request.getfixturevalue("filled"), path)
    with Registry.open(path) as registry:
        yield registry


@pytest.fixture
def shared(stores, filled_shared: str, tmp_path: Path) -> Iterator[Registry]:
    """A copy of the small registry on the servers, open."""
    name = stores.new(like=filled_shared)
    with Registry.share(tmp_path / "registry", stores.catalog(name), stores.blobs(name)) as registry:
        yield registry
    stores.drop(name)
