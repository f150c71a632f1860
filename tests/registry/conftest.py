"""A small registry: one robot, a population of 10 entries in shards of 4, one recording."""

from pathlib import Path

import pytest
from registry_contents import ROBOT, fill, make_recording, make_robot

from dynreg.registry.registry import Registry


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "registry"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return make_robot(tmp_path / "robot")


@pytest.fixture
def registry(path: Path, robot: Path):
    with Registry.open(path, create=True) as registry:
        fill(registry, robot)
        recording = registry.put_recording(make_recording(1), ROBOT, "first run")
        registry.put_result("neighbours", recording, {"k": 5})
        registry.put_simulator({"robot": ROBOT, "values": {"mass": 1.5}})
        registry.put_index("bench", "landmarks", {"losses": registry.load("bench").values})
        yield registry
