"""Each cost beside its limit on this machine: bare physics steps, matrix products, memory, disk.

    python benchmarks/bench_limits.py

The limit of a work is what the machine does of its kind when nothing else is in the way: a bare MuJoCo loop, a product
of large float32 matrices, a copy in memory, a file that is written and synced. Each work and its limit are timed in
turn, three times; the best of each counts. Models and rows are of a quadruped's size.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from bare_physics import physics
from kept import RESULTS, keep
from model_family import TRAIN_ROWS, family

from dynreg.distance.population import Training
from dynreg.models.bank import LossBank
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, initial
from dynreg.models.threads import available_threads
from dynreg.models.train import Passes, train
from dynreg.registry.codec import decode_arrays, encode_arrays
from dynreg.registry.files import write_file

ROUNDS = 3
PRODUCT = 2048  # rows and columns of the matrices
COPIED = 1 << 28  # bytes


def main() -> None:
    """Measure, print and keep the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", type=int, default=200)
    given = parser.parse_args()
    rows = [stepped(), *computed(given.models), *moved(given.models)]
    for row in rows:
        print(
            f"{row['work']:42} {row['rate']:10.3g} {row['limit']:10.3g} {row['unit']:12} {row['share']:7.2f}"
        )
    keep(RESULTS / "limits.json", {"cores": available_threads(), "rows": rows}, parser, given)


def stepped() -> dict[str, Any]:
    """Physics steps/s of the engine beside a bare loop."""
    found = physics()
    return row("simulate: physics steps", found["engine"], found["bare"], "steps/s")


def computed(models: int) -> list[dict[str, Any]]:
    """Floating-point operations/s of training, losses and predictions beside a large product on all cores."""
    inputs, targets = family(models, 20261126)
    x, y = inputs[:, :TRAIN_ROWS], targets[:, :TRAIN_ROWS]
    start = initial(inputs.shape[-1], targets.shape[-1], 1, seed=0)
    held, wanted = inputs[:, TRAIN_ROWS:], targets[:, TRAIN_ROWS:]
    stack = train(start, x, y, Passes(epochs=1))
    each = 2 * sum(w[0].size for w in stack.weights)  # operations of one row in one model
    some = Training()
    passes = Passes(some.epochs, some.learning_rate, some.batch_size)
    bank, ids = LossBank(stack, held, wanted), np.arange(models)
    pairs = np.repeat(ids, 24), np.tile(ids[:24], models)  # as many as a new entry is compared with
    works: dict[str, tuple[Callable[[], Any], float]] = {
        "train: forward, backward, no Adam counted": (
            lambda: train(start, x, y, passes),
            3 * each * models * TRAIN_ROWS * some.epochs,
        ),
        "link: losses of pairs": (lambda: bank.pairs(*pairs), each * len(pairs[0]) * held.shape[1]),
        "query: predictions on shared rows": (lambda: predict(stack, held[0]), each * models * held.shape[1]),
    }
    matrix = torch.rand(PRODUCT, PRODUCT)
    limit = 2 * PRODUCT**3
    return [
        row(name, *rates((work, operations), (lambda: matrix @ matrix, limit)), "flop/s")
        for name, (work, operations) in works.items()
    ]


def moved(models: int) -> list[dict[str, Any]]:
    """Bytes/s of models read from a warm file beside a copy in memory, and of a shard stored beside a bare write."""
    stack: MlpStack = initial(55, 33, models, seed=0)
    data = encode_arrays(stack.as_arrays(), {})
    source = np.ones(COPIED, np.uint8)
    with tempfile.TemporaryDirectory(dir=os.getcwd()) as folder:
        place, bare = Path(folder) / "stored", Path(folder) / "bare"
        write_file(place, data)
        read = rates((lambda: decode_arrays(place), len(data)), (source.copy, COPIED))
        stored = rates((lambda: write_file(place, data), len(data)), (lambda: synced(bare, data), len(data)))
    return [
        row("query: models read from a warm file", *read, "byte/s"),
        row("populate: a file of models stored", *stored, "byte/s"),
    ]


def synced(path: Path, data: bytes) -> None:
    """Write and sync, with nothing else."""
    with path.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def rates(*works: tuple[Callable[[], Any], float]) -> tuple[float, ...]:
    """The best amount/s of each work, all timed in turn."""
    best = [0.0] * len(works)
    for _ in range(ROUNDS):
        for at, (work, amount) in enumerate(works):
            began = time.perf_counter()
            work()
            best[at] = max(best[at], amount / (time.perf_counter() - began))
    return tuple(best)


def row(work: str, rate: float, limit: float, unit: str) -> dict[str, Any]:
    """One line of the table."""
    return {"work": work, "rate": rate, "limit": limit, "unit": unit, "share": rate / limit}


if __name__ == "__main__":
    main()
