"""How fast datasets and models come out of a registry, and what they cost on disk and in memory.

    python benchmarks/bench_datasets.py [--entries 1000] [--streamed 10000] [--against CHECKOUT]

- rows a second: batches of `reg.dataset(...).to_torch()` against the bare reading of the same Parquet files by pyarrow;
- predictions: `reg.model(population).predict` of all entries at once against torch's batched products alone;
- memory: a process that streams a made-up population of as many entries as --streamed, of a quadruped's shape;
- disk: bytes an entry and the time to load it, of this checkout and of an older one (--against);
- export and import of as many servos with a recording: bytes, seconds, whether ids and a query's answer stay the same.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pyarrow.parquet as pq
import torch
from kept import RESULTS
from servo_log import write_log

import dynreg

HERE = Path(__file__).parent
ROUNDS = 7
SHAPE = (20, 51, 33)  # episodes, states and channels of a quadruped's entry

STREAM = """
import sys, time
import dynreg
def peak():
    with open("/proc/self/status") as told:
        return next(int(line.split()[1]) for line in told if line.startswith("VmHWM")) / 1e3
with dynreg.open(sys.argv[1]) as reg:
    data = reg.dataset("big")
    before, began = peak(), time.perf_counter()
    rows = sum(len(batch.state) for batch in data.to_torch())
    print(rows, time.perf_counter() - began, before, peak())
"""
DISK = """
import json, sys, time
from pathlib import Path
import dynreg
place, n = Path(sys.argv[1]), int(sys.argv[2])
assert Path(dynreg.__file__).is_relative_to(sys.argv[3]), dynreg.__file__
out = {}
for robot in ("servo_pendulum", "quadruped"):
    with dynreg.open(place / robot) as reg:
        made = reg.populate(robot, n, link=False)
        sizes = {s: sum(f.stat().st_size for f in (place / robot / "shards").glob("*." + s)) / n
                 for s in ("parquet", "safetensors")}
        store, times = reg.registry, []
        for _ in range(5):
            began = time.perf_counter(); ids = store.load(made.population, ("states",)).ids
            times.append((time.perf_counter() - began) / n)
        began = time.perf_counter()
        for one in ids[:20]: store.load_entry(one)
        out[robot] = sizes | {"load": sorted(times)[2], "one": (time.perf_counter() - began) / 20}
print(json.dumps(out))
"""


def main() -> None:
    """Print the figures and write benchmarks/results/datasets.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--streamed", type=int, default=10_000)
    parser.add_argument("--against", type=Path, help="an older checkout of dynreg, to compare the disk with")
    given = parser.parse_args()
    out = {}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        with dynreg.open(place / "registry") as reg:
            reg.populate("quadruped", given.entries, link=False)
            out |= {"rows": rows(reg), "predict": predictions(reg)}
        with dynreg.open(place / "servos") as reg:
            reg.populate("servo_pendulum", given.entries)
            reg.ingest(write_log(place), "servo_pendulum", name="run")
            out["import"] = moved(reg, place)
        print(json.dumps(out), flush=True)
        out["memory"] = streamed(place / "big", given.streamed)
        sides = {"now": HERE.parent} | ({"before": given.against.resolve()} if given.against else {})
        out["disk"] = {side: asked(checkout, place / side) for side, checkout in sides.items()}
    print(json.dumps(out, indent=1))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "datasets.json").write_text(json.dumps(out, indent=1) + "\n")


def rows(reg: dynreg.Session) -> dict[str, float]:
    """Millions of rows a second, the median of rounds in turn, and the ratios to the bare reading."""
    files = sorted((reg.path / "shards").glob("*.parquet"))
    data = reg.dataset("quadruped")

    def bare() -> int:
        return sum(b.num_rows for f in files for b in pq.ParquetFile(f).iter_batches())

    ways = {
        "parquet": bare,
        "torch": lambda: sum(len(b.state) for b in data.to_torch()),
        "torch, shuffled": lambda: sum(len(b.state) for b in data.to_torch(seed=1)),
        "numpy": lambda: len(data.to_numpy()),
        "arrow": lambda: sum(b.num_rows for b in data.to_arrow()),
    }
    return _with_ratios({name: n / t / 1e6 for name, (n, t) in timed(ways).items()}, "parquet")


def predictions(reg: dynreg.Session) -> dict[str, float]:
    """Millions of predictions a second, all entries on the same 256 rows, and the ratio to bare products."""
    model = reg.model("quadruped")
    data = reg.dataset(model.entries[0]).to_numpy()
    states, actions, context = data.states[:256], data.actions[:256], data.context[:256]
    inputs = torch.from_numpy(model.normaliser.inputs(states, actions, context))
    weights = [torch.tensor(w) for w in model.stack.weights]
    biases = [torch.tensor(b)[:, None] for b in model.stack.biases]
    module = model.torch()
    tensors = [torch.from_numpy(a.copy()) for a in (states, actions, context)]

    def bare() -> int:
        hidden = inputs.expand(len(model), *inputs.shape)
        for i, (w, b) in enumerate(zip(weights, biases, strict=True)):
            hidden = torch.baddbmm(b, hidden, w)
            hidden = hidden.relu_() if i < 3 else hidden
        return hidden.shape[0] * hidden.shape[1]

    def all_at_once() -> int:
        with torch.no_grad():
            return module(*tensors).numel() // len(model.states)

    ways = {
        "products": bare,
        "predict": lambda: model.predict(states, actions, context).size // len(model.states),
        "module": all_at_once,
    }
    return _with_ratios({name: n / t / 1e6 for name, (n, t) in timed(ways).items()}, "products")


def moved(reg: dynreg.Session, place: Path) -> dict[str, object]:
    """Bytes and seconds of an export and an import of the population, and what stays the same."""
    began = time.perf_counter()
    reg.export([reg.populations().items[0].id, "run"], place / "exported")
    exported = time.perf_counter() - began
    size = sum(f.stat().st_size for f in (place / "exported").rglob("*") if f.is_file())
    with dynreg.open(place / "imported") as other:
        began = time.perf_counter()
        other.import_registry(place / "exported")
        imported = time.perf_counter() - began
        same = list(other.population("servo_pendulum").id) == list(reg.population("servo_pendulum").id)
        answers = [_document(one.query("run", budget=100)) for one in (reg, other)]
    return {
        "bytes": size,
        "export_s": exported,
        "import_s": imported,
        "same_ids": same,
        "same_query": answers[0] == answers[1],
    }


def _document(found) -> str:
    """A query's document without the time that it took."""
    told = found.to_dict()
    told["cost"].pop("seconds")
    return json.dumps(told, sort_keys=True)


def streamed(path: Path, entries: int) -> dict[str, float]:
    """Rows, seconds and memory [MB] of a process that reads a made-up population once."""
    from dynreg.data.recording import Channel
    from dynreg.registry import PopulationRecord, Registry, ShardData

    episodes, states, channels = SHAPE
    rng = np.random.default_rng(0)
    record = PopulationRecord(
        "ab" * 32,
        "cd" * 32,
        "big",
        tuple(Channel(f"c{i}", "rad") for i in range(channels)),
        ("mass",),
        entries,
        seed=0,
        arrays={
            "bank.actions": rng.normal(size=(episodes, states - 1, 12)),
            "normaliser.input_mean": np.zeros(channels + 12, np.float32),
            "normaliser.input_std": np.ones(channels + 12, np.float32),
            "normaliser.delta_mean": np.zeros(channels, np.float32),
            "normaliser.delta_std": np.ones(channels, np.float32),
        },
        actions=tuple(Channel(f"a{i}", "rad") for i in range(12)),
    )
    robot = path.with_name("robot")
    robot.mkdir()
    (robot / "robot.toml").write_text('[robot]\nname = "big"\n')
    with Registry.open(path, create=True) as registry:
        registry.put_robot(robot, record.robot_hash, "big")
        registry.put_population(record)
        for first, last in registry.missing_spans("big"):
            n = last - first
            moves = rng.normal(size=(n, *SHAPE)).astype(np.float32).cumsum(axis=2)
            one = np.ones(n)
            registry.put_shard(
                "big",
                first,
                ShardData(np.arange(first, last)[:, None], moves, {"w": one[:, None]}, one, one),
            )
    told = subprocess.run(
        [sys.executable, "-c", STREAM, path], check=True, capture_output=True, text=True
    ).stdout.split()
    return dict(zip(("rows", "seconds", "before_mb", "peak_mb"), map(float, told), strict=True))


def asked(checkout: Path, place: Path) -> dict[str, dict[str, float]]:
    """Bytes and seconds an entry, as a checkout writes and reads them."""
    place.mkdir()
    command = [sys.executable, "-c", DISK, place, "200", checkout]
    env = os.environ | {"PYTHONPATH": str(checkout)}
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=env, cwd=checkout)
    return json.loads(done.stdout.splitlines()[-1])


def timed(ways: dict[str, Callable[[], int]]) -> dict[str, tuple[int, float]]:
    """(what each counts, the median of its times [s]), in rounds that take them in turn; the first is not counted."""
    found: dict[str, list[float]] = {name: [] for name in ways}
    counts = {}
    for _ in range(ROUNDS + 1):
        for name, way in ways.items():
            began = time.perf_counter()
            counts[name] = way()
            found[name].append(time.perf_counter() - began)
    return {name: (counts[name], median(times[1:])) for name, times in found.items()}


def _with_ratios(speeds: dict[str, float], base: str) -> dict[str, float]:
    return speeds | {
        f"{name} / {base}": speed / speeds[base] for name, speed in speeds.items() if name != base
    }


if __name__ == "__main__":
    main()
