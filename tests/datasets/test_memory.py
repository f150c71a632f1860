"""A big population is exported part by part: it never lies in memory as a whole."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynreg import session
from dynreg.registry import ShardData

MEGABYTES = 500
EXPORT = """
import re, sys
from pathlib import Path
from dynreg import session
with session.open("registry", create=False) as opened:
    told = opened.export_dataset(opened.populations().items[0].id, "out", sys.argv[1])
(peak,) = re.findall(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())
print(told.entries, int(peak) // 1024)
"""


@pytest.fixture(scope="module")
def crowded(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a registry of 10,000 entries: those of the tiny one, each a little changed."""
    place, rng = tmp_path_factory.mktemp("crowded"), np.random.default_rng(0)
    with session.open(shutil.copytree(registry_folder, place / "registry")) as opened:
        registry = opened.registry
        (population,) = (item.id for item in opened.populations().items)
        held = registry.load(population)
        registry.put_population(replace(registry.population(population), size=10_000))
        for first, stop in registry.missing_spans(population):
            pick = rng.integers(0, len(held), stop - first)
            states = held.states[pick]
            data = ShardData(
                held.values[pick],
                states + rng.normal(0, 1e-3, states.shape).astype(np.float32),
                {name: array[pick] for name, array in held.weights.items()},
                held.own_loss[pick],
                held.train_loss[pick],
                {},
                np.full(states.shape[:2], 0.01),
            )
            registry.put_shard(population, first, data)
    return place


@pytest.mark.slow
@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="nothing tells the peak of a process's memory"
)
@pytest.mark.parametrize("form", ["parquet", "csv", "lerobot", "safetensors"])
def test_ten_thousand_entries_need_little_memory(form: str, crowded: Path) -> None:
    line = [sys.executable, "-c", EXPORT, form]
    done = subprocess.run(line, cwd=crowded, capture_output=True, text=True, timeout=600, check=True)
    shutil.rmtree(crowded / "out") if (crowded / "out").is_dir() else (crowded / "out").unlink()
    (crowded / "out.md").unlink(missing_ok=True)
    entries, peak = map(int, done.stdout.split())
    assert entries == 10_000 and peak < MEGABYTES
