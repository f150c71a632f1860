"""Diagnosis of the real double pendulum from the published model without friction and rotors, beside its peers.

The eight runs of excitation are to fit and select by; the two swing-ups are held out.
The torque was measured at the drives, so what happens between a command and its torque cannot be a cause; encoders
count the motor's turns through a fixed gear, so their scale cannot be one. Error:
open-loop rollouts of 0.5 s and 1 s from measured states every 0.25 s, driven by the measured torque, both joints'
positions [rad]: root mean square, and the median window (windows near upright diverge, whatever the model).
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from kept import RESULTS
from open_loop import Segments, rms, simulated, window_errors
from peers import Knob, Motion, Peer, identify, sparse

import dynreg
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
HELD_OUT = ["C1_154220", "C1_154548"]
WINDOW, EVERY = 0.5, 0.25  # s: of a piece to fit, and between the starts of the held-out rollouts
FILTER = 15.0  # Hz, for regression on accelerations
JOINTS = ("shoulder", "elbow")
RULED_OUT = (
    "command_delay",
    "command_gain",
    "rate_limit",
    "command_lag",
    "command_deadband",
    "torque_limit",
    "speed_limit",
    "drive_gain",
    "voltage_sag",
    "thermal_fade",
    "encoder_scale",
)


def knobs() -> list[Knob]:
    """What a person frees who knows that friction and rotors are missing; the ranges are those of robot.toml."""
    out = []
    for p in load_robot("double_pendulum").file.parameters:
        body, what = p.name.split("_")
        out.append(Knob(p.name, p.nominal, p.low, p.high, _rigid(body, what)))
    for joint in JOINTS:
        out.append(Knob(f"{joint}_coulomb", 0.05, 0.0, 0.6, _of_joint(joint, "frictionloss")))
        out.append(Knob(f"{joint}_viscous", 0.005, 0.0, 0.1, _of_joint(joint, "damping")))
    out.append(Knob("rotor", 0.001, 0.0, 0.02, _of_joint("*", "armature")))
    return out


def _rigid(body: str, what: str):
    def write(spec: mujoco.MjSpec, value: float) -> None:
        if what == "length":
            spec.body("lower").pos = [value, 0, 0]
        elif what == "com":
            spec.body(body).ipos = [value, 0, 0]
        elif what == "mass":
            spec.body(body).mass = value
        else:
            spec.body(body).inertia = [0.005, value, value]

    return write


def _of_joint(joint: str, field: str):
    def write(spec: mujoco.MjSpec, value: float) -> None:
        for name in JOINTS if joint == "*" else (joint,):
            setattr(spec.joint(name), field, [value, 0, 0] if field == "damping" else value)

    return write


def scores(run, robot, recording) -> dict[str, float]:
    """Errors of `run(segments)` on the held-out runs."""
    out = {}
    for seconds in (0.5, 1.0):
        segments = Segments.cut(robot, recording, HELD_OUT, seconds, EVERY)
        errors = window_errors(run(segments), segments, 2)
        out |= {f"rmse {seconds:g} s": rms(errors), f"median {seconds:g} s": float(np.median(errors))}
    return out


def peers(robot, recording, train: list[str]) -> list[Peer]:
    """mujoco.sysid and sparse regression on the same runs."""
    xml = (robot.folder / robot.file.robot.model).read_text(encoding="utf-8")
    found = identify(xml, knobs(), Segments.cut(robot, recording, train, WINDOW, WINDOW))
    parts = (train[::2], train[1::2])
    fit, select = (Motion.of(robot, recording, part, filter_hz=FILTER, every=10) for part in parts)
    return [p for p in (found, sparse(robot.model, fit, select)) if p]


def main() -> None:
    """Print the table and write benchmarks/results/diagnose_double_pendulum.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--max-causes", type=int, default=3)
    parser.add_argument("--threshold-runs", type=int, default=0)
    parser.add_argument("--effects", nargs="*", help="only these effects [all but those ruled out]")
    parser.add_argument("--runs", nargs="*", help="runs to fit and select by [all eight]")
    parser.add_argument("--windows", type=int, default=32, help="rollouts to fit, and as many to select by")
    parser.add_argument("--peers", action=argparse.BooleanOptionalAction, default=True)
    given = parser.parse_args()
    logs = sorted((DATA / "dfki_double_pendulum").glob("*.parquet"))
    if not logs:
        print("bench_diagnose_double_pendulum: skipped, no double pendulum log in DYNREG_DATA_DIR")
        return
    held = [log for log in logs if log.stem in HELD_OUT]
    train = [log for log in logs if log.stem not in HELD_OUT]
    train = [log for log in train if not given.runs or log.stem in given.runs]
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        identity = reg.ingest([*train, *held], "double_pendulum", name="swings").recording
        recording, robot = reg.registry.recording(identity), load_robot("double_pendulum")
        began, used = time.perf_counter(), time.process_time()
        found = reg.diagnose(
            identity,
            hold_out=",".join(HELD_OUT),
            threshold_runs=given.threshold_runs,
            max_causes=given.max_causes,
            effects=given.effects,
            without=() if given.effects else RULED_OUT,
            threads=given.threads,
            windows=given.windows,
        )
        seconds, used = time.perf_counter() - began, time.process_time() - used
        rows = []
        for label, simulator in (
            ("published 1.1", None),
            ("calibrated", found.calibrated_simulator),
            ("diagnosed", found.extended_simulator),
        ):
            config = (
                SimConfig.from_dict(reg.registry.simulator(simulator))
                if simulator
                else SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal))
            )
            run = lambda segments, config=config: simulated(robot, config, segments)  # noqa: E731
            rows.append({"model": label, **scores(run, robot, recording)})
        rows[-1] |= {
            "seconds": seconds,
            "core_seconds": used,
            "named": ", ".join(c.key for c in found.causes),
        }
        for peer in peers(robot, recording, [log.stem for log in train]) if given.peers else ():
            rows.append({"model": peer.name, **scores(peer.run, robot, recording)})
            rows[-1] |= {"seconds": peer.seconds, "named": peer.named, "values": peer.values}
    report(found, rows, vars(given))


def report(found, rows: list[dict], asked: dict) -> None:
    """Print the causes and the table, and keep both."""
    print(f"{found.verdict}:")
    for cause in found.causes:
        sizes = ", ".join(
            f"{k} {v.value:.4g} ({v.low:.4g} to {v.high:.4g}) {v.unit}" for k, v in cause.parameters.items()
        )
        print(f"  {cause.key}: {sizes}; {cause.evidence_nats:.0f} nats")
    print(f"\n{'':18s}  0.5 s: RMSE (median)   1 s: RMSE (median) [rad]   seconds")
    for row in rows:
        print(
            f"{row['model']:18s}  {row['rmse 0.5 s']:6.3f} ({row['median 0.5 s']:.4f})"
            f"        {row['rmse 1 s']:6.3f} ({row['median 1 s']:.4f})"
            f"          {row.get('seconds', 0):6.1f}   {row.get('named', '')[:150]}"
        )
    document = {
        "asked": asked,
        "verdict": found.verdict,
        "causes": [
            {"key": c.key, "nats": c.evidence_nats, **{k: v.value for k, v in c.parameters.items()}}
            for c in found.causes
        ],
        "ranking": [[r.round, r.key, r.score_nats] for r in found.ranking],
        "rows": rows,
    }
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "diagnose_double_pendulum.json").write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
