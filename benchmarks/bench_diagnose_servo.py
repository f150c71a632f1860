"""Diagnosis of the real XL330 bench: the cause, and the error on the held-out gain, with and without the supply.

6 s closed-loop rollouts from t = 0, mean absolute error of position [rad]. The structure is chosen on the other
three gains alone. The bench's nameplate is a rough guess, so its tolerances are widened fivefold, for the
threshold's robots too.
"""

import argparse
import json
import os
import tempfile
from pathlib import Path

import numpy as np

import dynreg
from dynreg.data.recording import Episode, Recording

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
TOLERANCE = 5.0


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
    """Print the table and write benchmarks/results/diagnose_servo.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--held-out", type=float, nargs="*", default=[400.0])
    parser.add_argument("--threshold-runs", type=int, default=0)
    given = parser.parse_args()
    logs = sorted((DATA / "bam_xl330_pendulum" / "raw").glob("*.json"))
    if not logs:
        print("bench_diagnose_servo: skipped, no XL330 log in DYNREG_DATA_DIR")
        return
    rows = []
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        measured = reg.ingest(logs, "servo_pendulum", name="measured").recording
        loaded = reg.registry.recording(measured)
        robot = reg._robot_of_recording(measured)
        nominal = reg.registry.put_recording(without(loaded, "supply"), robot.hash, "nominal")
        for supply, recording in (("measured supply", measured), ("nominal supply", nominal)):
            for kp in given.held_out:
                found = reg.diagnose(
                    recording, hold_out=f"kp={kp:g}", tolerance=TOLERANCE, threshold_runs=given.threshold_runs
                )
                error = next(e for e in found.errors if e.channel == "arm/position")
                causes = [f"{c.key} ({c.evidence_nats:.0f} nats)" for c in found.causes]
                rows.append(
                    {
                        "supply": supply,
                        "held out": kp,
                        "verdict": found.verdict,
                        "causes": causes,
                        "ranking": [[r.key, r.score_nats] for r in found.ranking if r.round == 1][:5],
                        "nominal": error.nominal,
                        "calibrated": error.calibrated,
                        "extended": error.extended,
                        "seconds": found.cost.seconds,
                    }
                )
                print(
                    f"{supply}, kp {kp:g} held out: {found.verdict}, {', '.join(causes) or 'no cause'}\n"
                    f"  error {error.nominal:.4f} nominal, {error.calibrated:.4f} calibrated, "
                    f"{error.extended:.4f} extended; {found.cost.seconds:.0f} s\n  ranking "
                    + ", ".join(f"{k} {n:.1f}" for k, n in rows[-1]["ranking"]),
                    flush=True,
                )
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / "diagnose_servo.json").write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
