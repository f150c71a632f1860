"""What `populate --dry-run` foretells beside what populating takes: seconds, bytes and memory.

    python benchmarks/bench_foretold.py [--robots servo_pendulum quadruped] [--sizes 200 1000] [--core]

Each dry run and each populate has a process of its own, one after the other, on one core. With --core times are core
seconds of the process, which tell something on a machine that has other work, too. It ends with status 1 where a ratio
foretold / measured leaves its `BOUNDS`.
"""

import argparse
import multiprocessing as mp
import resource
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from kept import RESULTS, keep

import dynreg.neighbours.entries as entries
from dynreg import session

# Foretold / measured. Seconds: what is foretold from 24 simulators on a machine whose load changes. Bytes: entries of
# one population differ little. Memory: the base model's is foretold from a smaller one.
BOUNDS = {"seconds": (0.67, 1.6), "bytes": (0.9, 1.1), "memory": (0.75, 1.35)}


def foretold(robot: str, n: int, core: bool) -> dict[str, float]:
    """What a dry run says: seconds by step and in all, bytes, memory."""
    _count(core)
    with tempfile.TemporaryDirectory() as folder, session.open(Path(folder) / "registry") as opened:
        told = opened.populate(robot, n, threads=1, dry_run=True).expected
    seconds = told.seconds
    steps = {
        "simulate": seconds["simulate"],
        "train": seconds["train"] + seconds["base"],
        "link": seconds["link"],
    }
    return steps | {
        "seconds": sum(seconds.values()),
        "bytes": told.disk_bytes,
        "memory": told.memory_bytes,
    }


def measured(robot: str, n: int, core: bool) -> dict[str, float]:
    """The same of a populate."""
    clock = _count(core)
    with tempfile.TemporaryDirectory() as folder, session.open(Path(folder) / "registry") as opened:
        began = clock()
        did = opened.populate(robot, n, threads=1)
        spent = clock() - began
        places = [opened.registry.path / name for name in ("shards", "index")]
        size = sum(path.stat().st_size for place in places for path in place.iterdir())
    steps = {"simulate": did.simulate_seconds, "train": did.train_seconds, "link": did.link_seconds}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return steps | {"seconds": spent, "bytes": size, "memory": peak}


def _count(core: bool):
    """The clock of this process, which times its steps from now on."""
    clock = time.process_time if core else time.perf_counter
    entries.time = SimpleNamespace(perf_counter=clock)
    return clock


def compared(robot: str, n: int, core: bool) -> dict[str, Any]:
    """Both, and the ratio of each figure."""
    both = []
    for one in (foretold, measured):
        with mp.get_context("spawn").Pool(1) as alone:
            both.append(alone.apply(one, (robot, n, core)))
    ratios = {name: both[0][name] / both[1][name] for name in both[0]}
    return {"robot": robot, "entries": n, "foretold": both[0], "measured": both[1], "ratio": ratios}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=["servo_pendulum", "quadruped"])
    parser.add_argument("--sizes", nargs="+", type=int, default=[200, 1000])
    parser.add_argument("--core", action="store_true", help="core seconds in place of seconds")
    told = parser.parse_args()
    rows, out = [], []
    for robot in told.robots:
        for n in told.sizes:
            row = compared(robot, n, told.core)
            rows.append(row)
            figures = " ".join(f"{name} {ratio:.2f}" for name, ratio in row["ratio"].items())
            spent, size = row["measured"]["seconds"], row["measured"]["bytes"]
            print(
                f"{robot} {n}: {spent:.0f} s, {size / 1e6:.0f} MB; foretold / measured: {figures}", flush=True
            )
            out += [
                f"{robot} {n}: {name} {row['ratio'][name]:.2f}"
                for name, (low, high) in BOUNDS.items()
                if not low <= row["ratio"][name] <= high
            ]
    keep(RESULTS / "foretold.json", {"bounds": BOUNDS, "rows": rows}, parser, told)
    if out:
        raise SystemExit(f"out of bounds: {'; '.join(out)}")


if __name__ == "__main__":
    main()
