"""Diagnosis of the real XL330 bench: the causes, and the error on the held-out gain, with and without the supply.

6 s closed-loop rollouts from t = 0, mean absolute error of position [rad]. Causes are chosen on the other three
gains alone. The bench's nameplate is a rough guess, so its tolerances are widened fivefold, for the threshold's
robots too. `--peers N` puts beside it mujoco.sysid and CMA-ES on the published friction ladder (N simulations each).
"""

import argparse
import json
import os
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from kept import RESULTS
from servo_peers import LADDER, identify, ladder

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.verbs.subjects import robot_of

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
FILE = RESULTS / "diagnose_servo.json"
TOLERANCE = 5.0
SUPPLIES = ("measured", "nominal")


def without(recording: Recording, channel: str) -> Recording:
    """The recording as if it had not logged a channel."""
    keep = [i for i, c in enumerate(recording.channels) if c.name != channel]
    episodes = tuple(
        Episode(e.name, e.time, np.array(e.values[:, keep]), e.settings) for e in recording.episodes
    )
    return Recording(
        tuple(recording.channels[i] for i in keep), episodes, recording.measured, recording.provenance
    )


def main() -> None:
    """Print every row as it is found; keep all of them in benchmarks/results/diagnose_servo.json."""
    given = _arguments()
    logs = sorted((DATA / "bam_xl330_pendulum" / "raw").glob("*.json"))
    if not logs:
        print("bench_diagnose_servo: skipped, no XL330 log in DYNREG_DATA_DIR")
        return
    rows: dict[str, dict] = json.loads(FILE.read_text()) if given.keep and FILE.exists() else {}
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        measured = reg.ingest(logs, "servo_pendulum", name="measured").recording
        loaded = reg.registry.recording(measured)
        robot = robot_of(reg.registry, measured)
        plain = without(loaded, "supply")
        reg.registry.put_recording(plain, robot.hash, "nominal")
        for supply in given.supply:
            for kp in given.held_out:
                if given.peers:
                    recording = loaded if supply == "measured" else plain
                    for row in _peers(robot, recording, kp, given):
                        _tell(rows, f"{supply} supply, kp {kp:g} held out, {row['name']}", row)
                for seed in given.seeds:
                    name = f"{supply} supply, kp {kp:g} held out, diagnosis, seed {seed}"
                    name += f", of {len(given.effects)} effects" if given.effects else ""
                    _tell(rows, name, _diagnosed(reg, supply, kp, seed, given))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--held-out", type=float, nargs="*", default=[400.0])
    parser.add_argument("--supply", nargs="*", choices=SUPPLIES, default=list(SUPPLIES))
    parser.add_argument("--seeds", type=int, nargs="*", default=[0])
    parser.add_argument("--effects", nargs="*", help="only these, where the whole library takes too long")
    parser.add_argument("--threshold-runs", type=int, default=0)
    parser.add_argument("--peers", type=int, default=2400, help="simulations of each; 0 for no peers")
    parser.add_argument("--keep", action="store_true", help="keep the rows of earlier runs")
    return parser.parse_args()


def _diagnosed(reg, supply: str, kp: float, seed: int, given: argparse.Namespace) -> dict:
    found = reg.diagnose(
        supply,
        hold_out=f"kp={kp:g}",
        tolerance=TOLERANCE,
        threshold_runs=given.threshold_runs,
        seed=seed,
        effects=given.effects,
        threads=1,
    )
    error = next(e for e in found.errors if e.channel == "arm/position")
    return {
        "verdict": found.verdict,
        "causes": {c.key: round(c.evidence_nats, 1) for c in found.causes},
        "equivalent": {c.key: c.equivalent for c in found.causes},
        "sizes": {c.key: {k: round(v.value, 4) for k, v in c.parameters.items()} for c in found.causes},
        "ranking": [[r.key, round(r.score_nats, 1)] for r in found.ranking if r.round == 1][:5],
        "nominal": error.nominal,
        "calibrated": error.calibrated,
        "held_out": error.extended,
        "inputs": found.inputs,
        "notes": found.notes,
        "simulations": found.cost.rollouts,
        "seconds": found.cost.seconds,
    }


def _peers(robot, recording: Recording, kp: float, given: argparse.Namespace):
    model, data = pose(
        robot, recording, DiagnosisOptions(hold_out=f"kp={kp:g}", tolerance=TOLERANCE, threads=1)
    )
    chosen, test = data.parts.chosen, np.flatnonzero(data.parts.test)
    for rung in LADDER:
        yield asdict(ladder(model, data, rung, chosen, test, seed=given.seeds[0], budget=given.peers))
    peer = identify(model, data, chosen, test)
    if peer is not None:
        yield asdict(peer)


def _tell(rows: dict[str, dict], name: str, row: dict) -> None:
    """Print a row, and write all of them."""
    said = ", ".join(f"{key} ({nats:.0f} nats)" for key, nats in row.get("causes", {}).items())
    verdict = f"{row['verdict']}: {said}" if said else "names no cause"
    fitted = (
        f"calibrated {row['calibrated']:.4f} -> " if "calibrated" in row else f"train {row['train']:.4f} -> "
    )
    print(f"{name}: {verdict}; {fitted}{row['held_out']:.4f}; {row['seconds']:.0f} s", flush=True)
    rows[name] = row
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
