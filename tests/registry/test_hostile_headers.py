"""A stranger's files, whole by their own hashes: what their headers say is checked before anything is made of it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from registry_contents import POPULATION, ROBOT, make_population, make_robot, make_shard

import dynreg.registry.shards as shards
from dynreg.errors import CorruptError
from dynreg.registry import Registry, verify
from dynreg.registry.loading import load_shards

HEADERS = {
    "a list of half a billion numbers": {"shape": [10**10, 0, 5, 3]},
    "a size that is no whole number": {"shape": [2.0, 2, 5, 3]},
    "a size below zero": {"shape": [-2, -2, 5, 3]},
    "a size beyond every limit": {"shape": [2, 2, 10**400, 3]},
    "more entries than its numbers": {"shape": [4, 1, 5, 3]},
    "a period that no float holds": {"periods": [[0.02, 10**400]] * 2},
    "a period that is no number": {"periods": [[0.02, float("nan")]] * 2},
    "a period of zero": {"periods": [[0.02, 0.0]] * 2},
    "numbers of more entries": {"stop": 7},
    "numbers that are texts": {"start": "0", "stop": "2"},
    "states that are others": {"states": ["arm/velocity", "arm/position", "supply"]},
    "states of which one stands twice": {"states": ["arm/position", "arm/position", "supply"]},
    "states that are no names": {"states": [["arm/position"], 1, None]},
    "a form of tomorrow": {"schema": "dynreg/shard/99"},
}


@pytest.fixture
def write(tmp_path: Path) -> Callable[[], Path]:
    """Write a registry of a population of two entries in one shard."""

    def written() -> Path:
        with Registry.open(tmp_path / "registry", create=True) as made:
            made.put_robot(make_robot(tmp_path / "robot"), ROBOT, "arm")
            made.put_population(make_population(2))
            made.put_shard("bench", 0, make_shard(0, 2))
        return tmp_path / "registry"

    return written


def ask(path: Path) -> None:
    """Ask everything that reads the rows of entries."""
    with Registry.open(path) as opened:
        entry = make_shard(0, 2).entry_ids(POPULATION)[0]
        for asked in (
            lambda: opened.load("bench"),
            lambda: opened.load_entry(entry),
            lambda: opened.parts("bench")[0].read(),
            lambda: list(load_shards(opened.directory, POPULATION)),
        ):
            with pytest.raises(CorruptError) as raised:
                asked()
            assert "\n" not in str(raised.value)


@pytest.mark.parametrize("title", HEADERS)
def test_a_shard_whose_header_lies_is_refused_and_found(title: str, write, monkeypatch) -> None:
    told = shards._header
    monkeypatch.setattr(shards, "_header", lambda *a: told(*a) | HEADERS[title])
    path = write()
    ask(path)
    assert verify(path).faults
    verify(path, repair=True)
    assert not verify(path).faults


def test_a_shard_of_tomorrow_is_not_called_damaged(write: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shards, "SCHEMA", "dynreg/shard/99")
    path = write()
    with pytest.raises(CorruptError, match="newer dynreg"), Registry.open(path) as opened:
        opened.load("bench")
