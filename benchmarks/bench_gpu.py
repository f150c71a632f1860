"""What a GPU gains, and whether it answers as the processor does: training, losses and predictions of many models.

    python benchmarks/bench_gpu.py [--models 200 1000]

The family is `model_family`'s. Both devices start from the same base model and see the same rows. Times are the
shortest of three after a first call that is not timed. Without a GPU it says so and ends.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from kept import RESULTS, keep
from model_family import TRAIN_ROWS, family

from dynreg.models.bank import LossBank
from dynreg.models.losses import predict
from dynreg.models.mlp import MlpStack, initial
from dynreg.models.threads import available_threads
from dynreg.models.train import Passes, train

DEVICES = ("cpu", "cuda")
QUERY_ROWS = 200  # of a recording, on which a query judges every model


def main() -> None:
    """Time all sizes on both devices, print the table and keep it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", type=int, nargs="+", default=[200, 1000])
    given = parser.parse_args()
    if not torch.cuda.is_available():
        print("torch sees no GPU here; nothing was measured")
        return
    machine = {"gpu": torch.cuda.get_device_name(), "cores": available_threads(), "torch": torch.__version__}
    print(" ".join(f"{name} {value}" for name, value in machine.items()))
    rows = [row for models in given.models for row in measured(models)]
    keep(RESULTS / "gpu.json", {"machine": machine, "rows": rows}, parser, given)


def measured(models: int) -> list[dict[str, Any]]:
    """Seconds of each work on both devices, and the largest relative difference of what comes out."""
    inputs, targets = family(models, 20261126)
    start = initial(inputs.shape[-1], targets.shape[-1], 1, seed=0)
    shown = inputs[:, :TRAIN_ROWS], targets[:, :TRAIN_ROWS]
    held = inputs[:, TRAIN_ROWS:], targets[:, TRAIN_ROWS:]
    once = Passes(epochs=2)
    trained = {d: train(start, *shown, once, device=d) for d in DEVICES}
    own = {d: _own(stack, *held) for d, stack in trained.items()}
    stack, query = trained["cpu"], (inputs[0, :QUERY_ROWS], targets[0, :QUERY_ROWS])
    banks = {d: LossBank(stack, *held, device=d) for d in DEVICES}
    works: dict[str, Callable[[str], np.ndarray]] = {
        "losses of all models on one set": lambda d: banks[d].of_set(*query),
        "losses of one model on all sets": lambda d: banks[d].of_model(stack[np.array([0])]),
        "predictions of all models": lambda d: predict(stack, query[0], device=d),
    }
    seconds = {d: _seconds(lambda d=d: train(start, *shown, once, device=d)) for d in DEVICES}
    rows = [_row(models, "train", seconds, _apart(own["cpu"], own["cuda"]))]
    for name, work in works.items():
        answers = {d: work(d) for d in DEVICES}
        seconds = {d: _seconds(lambda d=d, work=work: work(d)) for d in DEVICES}
        rows.append(_row(models, name, seconds, _apart(answers["cpu"], answers["cuda"])))
    return rows


def _own(stack: MlpStack, inputs: np.ndarray, targets: np.ndarray) -> np.ndarray:
    every = np.arange(len(stack))
    return LossBank(stack, inputs, targets, device="cpu").pairs(every, every)


def _row(models: int, work: str, seconds: dict[str, float], apart: float) -> dict[str, Any]:
    ratio = seconds["cpu"] / seconds["cuda"]
    print(
        f"{models:6} {work:34} {seconds['cpu']:8.3f} s {seconds['cuda']:8.3f} s  x{ratio:6.2f}  {apart:.1e}"
    )
    return {"models": models, "work": work, **seconds, "ratio": ratio, "largest relative difference": apart}


def _seconds(call: Callable[[], Any]) -> float:
    """The shortest of three calls [s]; a device's work has ended when numbers are back in numpy."""
    best = np.inf
    for _ in range(3):
        began = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - began)
    return best


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(one).mean())


if __name__ == "__main__":
    main()
