"""Killed populates and populates in company lose nothing; `benchmarks/bench_crash.py` is what does it."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def bench() -> Iterator[ModuleType]:
    sys.path.insert(0, str(BENCHMARKS))
    import bench_crash

    yield bench_crash
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.parametrize("kills", [3, pytest.param(25, marks=pytest.mark.slow)])
def test_a_killed_populate_leaves_a_sound_registry_and_ends_as_an_undisturbed_one(bench, tmp_path, kills):
    died, after = bench.endure_kills(tmp_path, kills, shard_size=5, entries=5 * kills)
    assert len(died) == kills and all(kill.clean for kill in died)
    assert after.same and after.clean and after.entries >= 5 * kills
    held = [kill.entries for kill in died]
    assert held == sorted(held), "what was stored stays"


@pytest.mark.parametrize("entries", [30, pytest.param(120, marks=pytest.mark.slow)])
def test_two_processes_share_a_populate_while_a_third_asks(bench, tmp_path, entries):
    after = bench.endure_company(tmp_path, entries, shard_size=5)
    assert after.same and after.clean and after.entries == entries
    assert sum(after.added) >= entries - 10, "each entry was computed at least once"
    assert after.answers >= 1
