"""The real XL330 servo: one query against a CMA-ES fit of the same parameters on the same replays.

Mean absolute error of position [rad] over 6 s closed-loop rollouts from t = 0. Train: kp 100, 200, 800; held
out: kp 400, read once, at the end. A simulation is one candidate through the twelve training runs; those of
the query alone are counted, as the thousand registered simulators serve every later query too.
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np
from kept import RESULTS

import dynreg

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
HELD_OUT = "kp=400"


def main() -> None:
    """Run the comparison and write benchmarks/results/servo.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--registry", default=str(HERE / "registry"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--cma-budget", type=int, default=1200)
    given = parser.parse_args()
    logs = sorted((DATA / "bam_xl330_pendulum" / "raw").glob("*.json"))
    if not logs:
        print("bench_servo: skipped, no XL330 log in DYNREG_DATA_DIR")
        return
    with dynreg.open(given.registry) as reg:
        summary = reg.populate("servo_pendulum", given.entries)
        print(f"{summary.entries} simulators ({summary.added} added in {summary.seconds:.0f} s)")
        recording = reg.ingest(logs, "servo_pendulum", name="xl330")
        found = reg.query(recording, k=5, hold_out=HELD_OUT, population=summary.population)
        spread = next(c.spread for c in found.channels if c.channel == "arm/position")
        rows = {}
        for stage in found.stages:
            train = _train(found, stage) * spread
            rows[stage.stage] = {
                "train": train,
                "held_out": stage.test * spread,
                "simulations": stage.simulations,
            }
        references = [
            _reference(reg, recording, seed, given.cma_budget, spread) for seed in range(given.seeds)
        ]
    cost = min(r["simulations"] for r in references)
    held = min(references, key=lambda r: r["train"])["held_out"]
    for seed, r in enumerate(references):
        rows[f"CMA-ES seed {seed}"] = r
    print(f"\n{'':16s} {'train':>8s} {'held out':>9s} {'simulations':>12s}   MAE of position [rad]")
    for name, r in rows.items():
        print(f"{name:16s} {r['train']:8.4f} {r['held_out']:9.4f} {r['simulations']:12d}")
    answer = rows["answer"]
    print(f"\nanswer / reference, held out: {answer['held_out'] / held:.3f} (wanted: at most 1.10)")
    print(
        f"simulations: {found.cost.rollouts} of the query, {cost} of the reference to within 2 % of its final "
        f"training error (best of {given.seeds} seeds): {found.cost.rollouts / cost:.3f} (wanted: at most 0.20)"
    )
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "servo.json").write_text(json.dumps(rows, indent=1) + "\n")


def _train(found, stage) -> float:
    fit, select = len(found.parts["fit"]), len(found.parts["select"])
    return (fit * stage.fit + select * stage.select) / (fit + select)


def _reference(reg, recording, seed: int, budget: int, spread: float) -> dict[str, float]:
    """Errors of one CMA-ES run and its first evaluation within 2 % of its final training error."""
    run = reg.calibrate(recording, seed=seed, budget=budget, hold_out=HELD_OUT)
    errors = np.array([step.error for step in run.history])
    first = run.history[int(np.argmax(errors <= 1.02 * errors[-1]))].simulations
    return {"train": run.train_error * spread, "held_out": run.test_error * spread, "simulations": int(first)}


if __name__ == "__main__":
    main()
