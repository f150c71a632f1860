"""A small registry with something of each kind, and its files one by one."""

import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.table import to_parquet
from dynreg.registry import MeasuredEntry, PopulationRecord, Registry, ShardData
from dynreg.registry.codec import encode_arrays
from dynreg.registry.ledger import pages_after, read_page
from dynreg.registry.shards import encode_rows
from fuzzer.scratch import held

_ROBOT, POPULATION = "ab" * 32, "cd" * 32
_CHANNELS = (Channel("arm/position", "rad"), Channel("arm/velocity", "rad/s"))
_HEADER = {"population": POPULATION, "start": 0, "stop": 2}
_FOLDERS = ("shards", "populations", "recordings", "measured", "simulators", "results", "index")


class copied:
    """A copy of the small registry, gone at the end of the block."""

    def __enter__(self) -> Path:
        sound = held("sound-registry", None)
        if not sound.exists():
            _fill(sound)
        self._folder = Path(tempfile.mkdtemp(dir=sound.parent)) / "registry"
        shutil.copytree(sound, self._folder)
        return self._folder

    def __exit__(self, *error: object) -> None:
        shutil.rmtree(self._folder.parent, ignore_errors=True)


def _fill(folder: Path) -> None:
    robot = folder.with_name("sound-robot")
    robot.mkdir()
    (robot / "robot.toml").write_text('[robot]\nname = "arm"\n')
    making = folder.with_name("making-registry")
    with Registry.open(making, create=True) as registry:
        registry.put_robot(robot, _ROBOT, "arm")
        registry.put_population(_population())
        registry.put_shard("bench", 0, _shard())
        recording = registry.put_recording(_made(), _ROBOT, "first run")
        registry.put_measured(_measured(recording))
        registry.put_result("neighbours", recording, {"k": 5})
        registry.put_simulator({"robot": _ROBOT, "values": {"mass": 1.5}})
        registry.put_index("bench", "landmarks", {"losses": np.ones((2, 2))})
    making.rename(folder)


@cache
def last_page() -> tuple[int, dict[str, Any]]:
    """Number of the last page of the small registry, and a page of all its rows."""
    with copied() as folder:
        pages = pages_after(folder, 0)
        documents = [json.loads(page.read_bytes()) for page in pages]
        _, before = read_page(pages[-1])
    put: dict[str, Any] = {}
    for document in documents:
        put |= document["put"]
    number = max(document["number"] for document in documents)
    return number, documents[-1] | {"put": put, "before": before, "removed": {"results": [["a"]]}}


@cache
def files() -> tuple[tuple[str, bytes], ...]:
    """The registered files of the small registry, by name; those of its robot are text."""
    with copied() as folder:
        found = sorted(p for p in folder.rglob("*") if p.is_file() and p.parent.name in _FOLDERS)
        return tuple((p.relative_to(folder).as_posix(), p.read_bytes()) for p in found)


def _population() -> PopulationRecord:
    return PopulationRecord(
        POPULATION,
        _ROBOT,
        "bench",
        _CHANNELS,
        ("mass",),
        2,
        shard_size=2,
        seed=7,
        spec={},
        arrays={"bank.actions": np.ones((2, 2, 1))},
        actions=(Channel("arm/target", "rad"),),
        parameter_units=("kg",),
    )


def _shard() -> ShardData:
    numbers = np.linspace(0.5, 1.0, 2)
    return ShardData(
        values=numbers[:, None],
        states=np.linspace(0, 1, 2 * 2 * 3 * 2).reshape(2, 2, 3, 2),
        weights={"w0": np.ones((2, 2, 2), np.float16)},
        own_loss=numbers,
        train_loss=numbers,
        extra={"falls": numbers},
        periods=np.full((2, 2), 0.02),
    )


def _measured(recording: str) -> MeasuredEntry:
    weights = {name: array[0] for name, array in _shard().weights.items()}
    return MeasuredEntry(POPULATION, recording, weights, own_loss=0.5, train_loss=0.25)


@cache
def states() -> bytes:
    """The Parquet file of a shard."""
    return encode_rows(_shard(), _population(), 0, _shard().entry_ids(POPULATION))


@cache
def rest() -> bytes:
    """The safetensors file of a shard."""
    shard = _shard()
    arrays = {"values": shard.values, "own_loss": shard.own_loss, "train_loss": shard.train_loss}
    arrays |= {"weights/w0": shard.weights["w0"], "extra/falls": shard.extra["falls"]}
    return encode_arrays(arrays, _HEADER)


def _made() -> Recording:
    time = np.arange(5) * 0.01
    episodes = tuple(Episode(f"run{i}", time, np.ones((5, 2)) * i, {"kp": 32.0 + i}) for i in range(2))
    return Recording(_CHANNELS, episodes, provenance={"source": "log.csv"})


@cache
def recording() -> bytes:
    """The file of a recording."""
    return to_parquet(_made())
