"""A population and a recording of the packaged quadruped, as older registries hold them: `form_2.zip` is such a one.

It was written with the version before files explained themselves: `python tests/registry/older_form.py FOLDER` there.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.registry import PopulationRecord, Registry, ShardData
from dynreg.rng import stream
from dynreg.sim.robot import Robot, load_robot

POPULATION = "ef" * 32
EPISODES, STEPS = 2, 3


def fill(
    registry: Registry,
    told: Any = lambda robot: {},
    periods: Any = lambda robot, values: {},
    quadruped: str | Path = "quadruped",
    values: np.ndarray | None = None,
) -> None:
    """Put them; told and periods : what newer records and shards hold besides. quadruped : the robot as it was.

    values : (4, P) parameters; drawn by default, which another processor rounds in another way.
    """
    robot = load_robot(quadruped)
    rng = stream(0, "older form")
    bank = {"actions": rng.normal(size=(EPISODES, STEPS, len(robot.actions)))}
    bank |= {"inputs": np.zeros((EPISODES, STEPS, 0)), "settings": np.zeros((EPISODES, 0))}
    record = PopulationRecord(
        POPULATION,
        robot.hash,
        robot.name,
        tuple(Channel(c.name, c.unit) for c in robot.file.channels),
        robot.space.names,
        4,
        seed=0,
        spec={"robot": robot.hash},
        arrays={f"bank.{name}": values for name, values in bank.items()},
        shard_size=2,
        **told(robot),
    )
    registry.put_robot(robot.files, robot.hash, robot.name)
    registry.put_population(record)
    values = drawn(robot) if values is None else values
    for start in (0, 2):
        registry.put_shard(POPULATION, start, _shard(robot, start, values[start : start + 2], periods))
    registry.put_recording(recording(), robot.hash, "monday")


def drawn(robot: Robot) -> np.ndarray:
    """(4, P) parameters of the entries."""
    return np.concatenate([robot.space.sample(start, start + 2, 0) for start in (0, 2)])


def _shard(robot: Robot, start: int, values: np.ndarray, periods: Any) -> ShardData:
    rng = stream(start, "shard")
    return ShardData(
        values,
        rng.normal(size=(2, EPISODES, STEPS + 1, len(robot.channels))),
        {"w0": rng.normal(size=(2, 3)).astype(np.float16)},
        np.array([0.5, 0.25]),
        np.array([0.5, 0.25]),
        **periods(robot, values),
    )


def recording() -> Recording:
    """Two episodes with a setting of their own."""
    rng = stream(1, "older form")
    episodes = (
        Episode(f"run{i}", 0.1 * np.arange(5), rng.normal(size=(5, 2)), {"load": float(i)}) for i in range(2)
    )
    return Recording((Channel("a/position", "rad"), Channel("a/target", "rad")), tuple(episodes))


if __name__ == "__main__":
    with Registry.open(Path(sys.argv[1]), create=True) as new:
        fill(new)
