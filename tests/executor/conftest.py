"""Executors under test."""

from collections.abc import Callable
from pathlib import Path

import pytest
import tiny_registry

from dynreg import session
from dynreg.executor import Executor
from dynreg.neighbours.entries import Stopwatch
from dynreg.registry import Registry
from dynreg.sim.robot import load_robot
from dynreg.verbs.populations import Plan, begin, fill

Filled = tuple[str, dict[str, bytes]]  # a registry's content hash, and the bytes of its shards by name
ROBOT, SHARDS, EACH = "servo_pendulum", 4, 2


def contents(path: Path) -> Filled:
    """What a registry holds."""
    with Registry.open(path) as registry:
        return registry.content_hash(), {p.name: p.read_bytes() for p in sorted((path / "shards").iterdir())}


@pytest.fixture(scope="session")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Filled:
    """A population that one process made."""
    path = tmp_path_factory.mktemp("usual") / "registry"
    with session.open(path) as opened:
        opened.populate(ROBOT, SHARDS * EACH, training=tiny_registry.QUICK, shard_size=EACH, link=False)
    return contents(path)


@pytest.fixture
def filled(tmp_path: Path) -> Callable[[Executor], Filled]:
    """The same population, its shards made by an executor."""

    def of(executor: Executor) -> Filled:
        told: list[int] = []
        with Registry.open(tmp_path / "registry", create=True) as registry:
            plan, watch = Plan(SHARDS * EACH, 0, tiny_registry.QUICK, EACH, 1), Stopwatch()
            identity = begin(registry, load_robot(ROBOT), plan, watch, lambda *_: None)
            fill(registry, identity, executor, watch, told.append)
        assert told[-1] == SHARDS * EACH
        assert watch.seconds["simulate"] > 0 and watch.seconds["train"] > 0
        return contents(tmp_path / "registry")

    return of
