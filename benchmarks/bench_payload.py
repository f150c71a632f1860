"""What six-joint arms carry at the flange: is its place named, and how many kilograms are found?

Ten arms with 0.8 to 4.5 kg, whose frictions, gains and rotors nothing tells (`payload_arms.py`: simulated by MuJoCo's
plain steps, not by dynreg's engine). Each is diagnosed from 36 s of all joints moving together, in rollouts of 1 s,
with `payload`, `com_offset` and `inertia` as candidates: on the heaviest link, on each link of the wrist, at the
flange, on each joint. No more, so that an arm takes minutes: all effects at all places are 200 candidates. Printed
and kept in benchmarks/results/payload.json: the first cause, kilograms hidden and found, the 90 % interval, seconds.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import payload_arms
from journal import Journal
from kept import RESULTS
from scipy.stats import binomtest

import dynreg

FILE = RESULTS / "payload.json"
EFFECTS = ("payload", "com_offset", "inertia")
LOADS = (0.8, 4.5)  # kg: a weak one by the effect's sizes is 0.4 kg
TUNE, REPORT = 1, 101  # first seeds of the development's arms, and of the report's
HORIZON, WINDOWS = 1.0, 8  # s of a rollout, and how many are fitted
NEAR = 0.10  # of the payload: by contract


def row(seed: int, effects: tuple[str, ...]) -> dict:
    """What is said of the arm of a seed."""
    arm = payload_arms.drawn(seed, *LOADS)
    with tempfile.TemporaryDirectory() as place, dynreg.open(Path(place) / "registry") as session:
        robot = payload_arms.folder(Path(place) / "robot")
        name = session.ingest(payload_arms.log_of(arm), robot, name="log").recording
        began = time.perf_counter()
        found = session.diagnose(
            name,
            hold_out=",".join(payload_arms.TESTS),
            effects=list(effects),
            windows=WINDOWS,
            horizon=HORIZON,
            max_causes=1,
            threshold_runs=0,
            threads=1,
        )
    first = found.causes[0] if found.causes else None
    mass = first.parameters.get("mass") if first else None
    return {
        "seed": seed,
        "hidden_kg": arm.payload,
        "named": first.key if first else None,
        "verdict": found.verdict,
        "found_kg": mass and mass.value,
        "interval_kg": mass and [mass.low, mass.high],
        "nats": first and first.evidence_nats,
        "equivalent": first and list(first.equivalent),
        "error_rad": [found.error.nominal, found.error.calibrated, found.error.extended],
        "seconds": time.perf_counter() - began,
    }


def summed(rows: list[dict]) -> dict:
    """How many are named at their place, how many of these within a tenth, and both, with 95 % intervals."""
    placed = [r["named"] == "payload[flange]" for r in rows]
    near = [r["found_kg"] is not None and abs(r["found_kg"] / r["hidden_kg"] - 1.0) <= NEAR for r in rows]
    held = [
        p and r["interval_kg"][0] <= r["hidden_kg"] <= r["interval_kg"][1]
        for p, r in zip(placed, rows, strict=True)
    ]
    out = {}
    for name, hits in (
        ("named at the flange", placed),
        ("within 10 %", near),
        ("both", [p and n for p, n in zip(placed, near, strict=True)]),
        ("90 % interval holds it", held),
    ):
        low, high = binomtest(sum(hits), len(rows)).proportion_ci(0.95)
        out[name] = {"number": sum(hits), "of": len(rows), "low": float(low), "high": float(high)}
        print(f"{name}: {sum(hits)} of {len(rows)} ({100 * low:.0f} to {100 * high:.0f} %)")
    return out


def main() -> None:
    """Print the figures, and keep them in benchmarks/results/payload.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--arms", type=int, default=10)
    parser.add_argument("--effects", nargs="+", default=list(EFFECTS), help="candidates")
    parser.add_argument("--journal", type=Path, default=Path(tempfile.gettempdir()) / "bench_payload.jsonl")
    parser.add_argument("--tune", action="store_true", help="the arms of the development; writes nothing")
    given = parser.parse_args()
    first = TUNE if given.tune else REPORT
    journal = Journal(given.journal, {"first": first, "effects": given.effects})
    journal.begin()
    rows = {one["seed"]: one for one in journal.lines()}
    for seed in range(first, first + given.arms):
        if seed not in rows:
            rows[seed] = journal.add(row(seed, tuple(given.effects)))
        told = ("seed", "named", "verdict", "hidden_kg", "found_kg", "interval_kg", "seconds")
        print(json.dumps({key: rows[seed][key] for key in told}), flush=True)
    some = [rows[seed] for seed in range(first, first + given.arms)]
    figures = summed(some)
    if not given.tune:
        FILE.write_text(json.dumps({"figures": figures, "arms": some}, indent=1) + "\n")


if __name__ == "__main__":
    main()
