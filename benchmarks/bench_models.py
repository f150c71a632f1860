"""Figures of dynreg.models: quality and time of training, time of losses.

    python benchmarks/bench_models.py [--quick]

The family is planted (`model_family`). Losses are mean squared errors of the normalised delta on held-out
episodes, the mean over configurations; persistence (predicting no motion) is the reference.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from model_family import TRAIN_ROWS, family

from dynreg.models.bank import LossBank
from dynreg.models.base import train_base
from dynreg.models.mlp import MlpStack, initial
from dynreg.models.threads import available_threads
from dynreg.models.train import Passes, train
from dynreg.rng import stream


def held_out(models: MlpStack, inputs: np.ndarray, targets: np.ndarray) -> float:
    """Mean loss of every model (or of the only one) on its own held-out rows."""
    bank = LossBank(models, inputs[:, TRAIN_ROWS:], targets[:, TRAIN_ROWS:])
    ids = np.arange(len(inputs))
    return float(bank.pairs(ids if len(models) > 1 else 0 * ids, ids).mean())


def timed(call: Callable, *args: Any, repeat: int = 1, **options: Any) -> tuple[Any, float, float]:
    """The result, the shortest time [s] of `repeat` calls, and the core time [s] of all threads in it."""
    best = np.inf, np.inf
    for _ in range(repeat):
        start = time.perf_counter(), time.process_time()
        result = call(*args, **options)
        best = min(best, (time.perf_counter() - start[0], time.process_time() - start[1]))
    return result, *best


def bench_base(inputs: np.ndarray, targets: np.ndarray, test: tuple, grid: list) -> MlpStack:
    """Base models over a grid of settings; the last one is kept."""
    for epochs, rate, batch in grid:
        flat = inputs.reshape(-1, inputs.shape[-1]), targets.reshape(-1, targets.shape[-1])
        base, seconds, cpu = timed(train_base, *flat, Passes(epochs, rate, batch))
        print(
            f"base of {len(inputs)} configurations, {epochs} epochs, rate {rate:g}, batch {batch}: "
            f"held-out {held_out(base, *test):.3f}, {seconds:.1f} s ({cpu:.1f} s of cores)",
            flush=True,
        )
    return base


def bench_train(base: MlpStack, inputs: np.ndarray, targets: np.ndarray, grid: list) -> MlpStack:
    """Entries trained from the base and from scratch over a grid of settings; the last one is kept."""
    rows = inputs[:, :TRAIN_ROWS], targets[:, :TRAIN_ROWS]
    scratch = initial(*base.sizes[:: len(base.sizes) - 1], len(inputs), 1)
    for name, epochs, rate, batch in grid:
        models, seconds, cpu = timed(
            train, base if name == "base" else scratch, *rows,
            Passes(epochs, rate, batch),
        )  # fmt: skip
        each = 1e3 / len(inputs)
        print(
            f"train from {name:7s} {epochs:2d} epochs, rate {rate:g}, batch {batch:3d}: "
            f"held-out {held_out(models, inputs, targets):.3f}, "
            f"{each * seconds:.1f} ms a model ({each * cpu:.1f} ms of a core)",
            flush=True,
        )
    return models


def bench_losses(models: MlpStack, inputs: np.ndarray, targets: np.ndarray) -> None:
    """Times of LossBank: one new set, chosen pairs of 64 rows, all pairs."""
    many = models[np.arange(1000) % len(models)]
    probes = inputs[np.arange(200) % len(inputs), :64], targets[np.arange(200) % len(inputs), :64]
    bank, seconds, _ = timed(LossBank, many, *probes)
    print(f"bank of 1000 models and 200 sets: {seconds:.2f} s")
    _, seconds, cpu = timed(bank.of_set, inputs[0, :250], targets[0, :250], repeat=5)
    print(f"1000 models on 250 rows of a new set: {seconds:.3f} s ({cpu:.3f} s of cores)")
    rng = stream(0, "pairs")
    for count in (1, 10, 100, 5000):
        ids = rng.integers(1000, size=count), rng.integers(200, size=count)
        _, seconds, cpu = timed(bank.pairs, *ids, repeat=5)
        print(
            f"{count:5d} pairs of 64 rows: {1e3 * seconds:8.2f} ms, {1e3 * cpu / count:.3f} ms of a core each"
        )
    few = LossBank(many[:50], *probes)
    _, seconds, cpu = timed(few.all, repeat=3)
    print(f"all 50 x 200 pairs of 64 rows: {seconds:.3f} s, {1e3 * cpu / 10_000:.3f} ms of a core each")


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer configurations")
    quick = parser.parse_args().quick
    configs = 24 if quick else 96
    inputs, targets = family(configs + 64, seed=1)
    pool, own = (inputs[:configs], targets[:configs]), (inputs[configs:], targets[configs:])
    print(f"{available_threads()} threads; persistence {np.square(own[1][:, TRAIN_ROWS:]).mean():.3f}")
    base = bench_base(*pool, own, [(12, 2e-3, 256)])
    grid = [("scratch", 4, 1e-3, 100), ("scratch", 20, 1e-3, 40)]
    grid += [
        ("base", epochs, 1e-3, batch) for epochs, batch in ((4, 100), (4, 40), (3, 50), (2, 64), (2, 40))
    ]
    bench_losses(bench_train(base, *own, grid), *own)


if __name__ == "__main__":
    main()
