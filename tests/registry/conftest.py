"""A small registry: one robot, a population of 10 entries in shards of 4, one recording."""

import shutil
from pathlib import Path

import pytest
from registry_contents import ROBOT, fill, make_measured, make_recording, make_robot

from dynreg.registry import Registry


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "registry"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return make_robot(tmp_path / "robot")


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small registry, made once; tests work on copies of it."""
    folder = tmp_path_factory.mktemp("filled")
    with Registry.open(folder / "registry", create=True) as registry:
        fill(registry, make_robot(folder / "robot"))
        recording = registry.put_recording(make_recording(1), ROBOT, "first run")
        registry.put_measured(make_measured(recording))
        registry.put_result("neighbours", recording, {"k": 5})
        registry.put_simulator({"robot": ROBOT, "values": {"mass": 1.5}})
        registry.put_index("bench", "landmarks", {"losses": registry.load("bench").values})
    return folder / "registry"


@pytest.fixture
def registry(path: Path, filled: Path):
    shutil.copytree(filled, path)
    with Registry.open(path) as registry:
        yield registry
