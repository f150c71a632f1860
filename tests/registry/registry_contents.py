"""What the tests of the registry put into it. Entries depend on their number alone."""

from pathlib import Path

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.registry import MeasuredEntry, PopulationRecord, Registry, ShardData
from dynreg.rng import stream

ROBOT = "ab" * 32
POPULATION = "cd" * 32
COMMANDED = {
    "actions": (Channel("arm/target", "rad"),),
    "inputs": (Channel("wind", "m/s"),),
    "settings": (Channel("load", "kg"),),
}
CHANNELS = (Channel("arm/position", "rad"), Channel("arm/velocity", "rad/s"), Channel("supply", "V"))

COLUMNS = (*CHANNELS, *COMMANDED["actions"], *COMMANDED["inputs"], *COMMANDED["settings"])


def make_robot(folder: Path) -> Path:
    (folder / "meshes").mkdir(parents=True)
    (folder / "robot.toml").write_text('[robot]\nname = "arm"\n')
    (folder / "meshes" / "link.stl").write_bytes(bytes(range(256)))
    return folder


def make_population(size: int = 10, shard_size: int = 4, **changes: object) -> PopulationRecord:
    arrays = {"normaliser": np.arange(6.0).reshape(2, 3), "base": np.ones((3, 4), np.float16)}
    arrays["bank.actions"] = np.linspace(-1.0, 1.0, 8).reshape(2, 4, 1)
    arrays["bank.inputs"] = arrays["bank.actions"] + 3.0
    arrays["bank.settings"] = np.array([[0.0], [0.25]])
    told = COMMANDED | {"parameter_units": ("kg", "1")}
    settings = told | {"seed": 7, "spec": {"ranges": {"mass": [0.5, 2.0]}}, "arrays": arrays} | changes
    return PopulationRecord(
        POPULATION, ROBOT, "bench", CHANNELS, ("mass", "friction"), size, shard_size=shard_size, **settings
    )


def make_shard(start: int, stop: int, seed: int = 0, episodes: int = 2, steps: int = 5) -> ShardData:
    draws = [stream(seed, "entry", number) for number in range(start, stop)]
    return ShardData(
        values=np.array([rng.uniform(0.5, 2.0, 2) for rng in draws]),
        states=np.array([rng.normal(size=(episodes, steps, len(CHANNELS))) for rng in draws]),
        weights={
            "w0": np.array([rng.normal(size=(3, 4)) for rng in draws], np.float16),
            "b0": np.array([rng.normal(size=4) for rng in draws], np.float16),
        },
        own_loss=np.array([rng.random() for rng in draws]),
        train_loss=np.array([rng.random() for rng in draws]),
        extra={"falls": np.array([float(rng.integers(5)) for rng in draws])},
        periods=np.tile(0.02 * np.arange(1, episodes + 1), (stop - start, 1)),
    )


def make_recording(seed: int) -> Recording:
    rng = stream(seed, "recording")
    episodes = [
        Episode(f"run{i}", np.arange(20) * 0.01, rng.normal(size=(20, 3)), {"kp": 32.0 + i}) for i in range(2)
    ]
    return Recording(CHANNELS, tuple(episodes), provenance={"source": f"log{seed}.csv"})


def make_measured(recording: str) -> MeasuredEntry:
    shard = make_shard(0, 1, seed=1)
    weights = {name: array[0] for name, array in shard.weights.items()}
    return MeasuredEntry(POPULATION, recording, weights, own_loss=0.5, train_loss=0.25)


def fill(registry: Registry, robot: Path, size: int = 10) -> None:
    registry.put_robot(robot, ROBOT, "arm")
    registry.put_population(make_population(size))
    populate(registry)


def populate(registry: Registry) -> int:
    """Fill what is missing, as a populating process does; returns the number of shards written."""
    written = 0
    for start, stop in registry.missing_spans("bench"):
        with registry.claim("bench", start) as mine:
            if mine:
                registry.put_shard("bench", start, make_shard(start, stop))
                written += 1
    return written
