"""Diagnosis of the real EMPS from its published mass and viscous friction, without dry friction, beside its peers.

DATA_EMPS is to fit and select by, DATA_EMPS_PULSES is held out. Errors: the force [share of the measured one] after
a 20 Hz filter without lag and decimation by 25, along the measured motion; and open-loop rollouts of 1 s from
measured states every 0.5 s, root mean square of position [mm].

Friction that differs between directions is, to any log, dry friction and a constant force: it is left out, so that
the two are told apart by name. The diagnosis runs twice: with all other effects, and with those of the published
structure alone (dry, viscous, Stribeck friction, a constant force).
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from kept import RESULTS
from open_loop import Segments, rms, simulated, window_errors
from peers import Knob, Motion, Peer, identify, sparse

import dynreg
from dynreg.data.recording import Recording
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import Robot, load_robot

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
TRAIN, TEST = "DATA_EMPS", "DATA_EMPS_PULSES"
GAIN = 35.15  # N/V
VISCOUS = 203.5034  # N s/m
SAME = ("asymmetric_friction",)
PUBLISHED = ("coulomb_friction", "viscous_friction", "stribeck_friction", "force_offset")
FILTER, DECIMATED = 20.0, 25  # Hz, rows
PUSH = 1.0  # V, by which the force that accelerates a simulator is measured
Run = Callable[[Segments], np.ndarray]


def force_error(run: Run, robot: Robot, recording: Recording, name: str) -> float:
    """|force that the simulator would need - measured| / |measured|, both as voltages.

    Of one time step from every filtered state: the acceleration that it lacks, times the voltage that this takes.
    """
    m = Motion.of(robot, recording, [name], filter_hz=FILTER, every=DECIMATED)
    states = np.repeat(np.concatenate([m.q, m.v], axis=1)[:, None], 2, axis=1)
    speeds = [
        run(Segments(states, (m.torque + push)[:, None], 1.0 / robot.rate))[:, 1, 1] for push in (0.0, PUSH)
    ]
    made = (speeds[0] - m.v[:, 0]) * robot.rate
    per_volt = np.median(speeds[1] - speeds[0]) * robot.rate / PUSH
    lacking = (m.a[:, 0] - made) / per_volt
    return float(np.linalg.norm(lacking) / np.linalg.norm(m.torque))


def scores(run: Run, robot: Robot, recording: Recording) -> dict[str, float]:
    """Errors on the held-out file: share of the force, and millimetres."""
    segments = Segments.cut(robot, recording, [TEST], 1.0, 0.5)
    return {
        "force": force_error(run, robot, recording, TEST),
        "rollout_mm": 1e3 * rms(window_errors(run(segments), segments, 1)),
    }


def knobs() -> list[Knob]:
    """What a person frees who knows that dry friction and a constant force are missing."""

    def field(name: str):
        return lambda spec, value: setattr(spec.joint("slider"), name, value)

    def mass(spec: mujoco.MjSpec, value: float) -> None:
        spec.body("carriage").mass = value

    def damping(spec: mujoco.MjSpec, value: float) -> None:
        spec.joint("slider").damping = [value, 0, 0]

    def force(spec: mujoco.MjSpec, value: float) -> None:
        # a constant force on the carriage: gravity that pulls along the slide, as an acceleration
        spec.option.gravity = [value, 0, -9.81]

    return [
        Knob("mass", 95.1089, 60.0, 140.0, mass),
        Knob("viscous", VISCOUS, 80.0, 800.0, damping),
        Knob("coulomb", 5.0, 0.0, 60.0, field("frictionloss")),
        Knob("acceleration", 0.0, -0.2, 0.2, force),
    ]


def peers(robot: Robot, recording: Recording) -> list[Peer]:
    """mujoco.sysid and sparse regression on the same file."""
    path = robot.folder / robot.file.robot.model
    found = identify(
        path.read_text(encoding="utf-8"),
        knobs(),
        Segments.cut(robot, recording, [TRAIN], 1.0, 1.0),
        gain=GAIN,
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:] = VISCOUS
    motion = Motion.of(robot, recording, [TRAIN], filter_hz=FILTER, every=DECIMATED, gain=GAIN)
    half = len(motion.q) // 2
    return [p for p in (found, sparse(model, motion.rows(0, half), motion.rows(half), gain=GAIN)) if p]


def diagnoses(reg, identity: str, given) -> list[dict]:
    """Both diagnoses, with their simulators."""
    out = []
    for label, effects in (("diagnosed", None), ("diagnosed, published structure", PUBLISHED)):
        began = time.perf_counter()
        found = reg.diagnose(
            identity,
            hold_out=TEST,
            effects=effects,
            without=SAME,
            threshold_runs=given.threshold_runs,
            threads=given.threads,
        )
        out.append({"model": label, "found": found, "seconds": time.perf_counter() - began})
    return out


def main() -> None:
    """Print the table and write benchmarks/results/diagnose_emps.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--threshold-runs", type=int, default=0)
    given = parser.parse_args()
    logs = sorted((DATA / "emps").glob("*.mat"))
    if not logs:
        print("bench_diagnose_emps: skipped, no EMPS log in DYNREG_DATA_DIR")
        return
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        identity = reg.ingest(logs, "emps", name="emps").recording
        recording, robot = reg.registry.recording(identity), load_robot("emps")

        def row(label: str, config: SimConfig) -> dict:
            return {"model": label, **scores(lambda s: simulated(robot, config, s), robot, recording)}

        made = diagnoses(reg, identity, given)
        stored = lambda i: SimConfig.from_dict(reg.registry.simulator(i))  # noqa: E731
        nominal = robot.space.as_dict(robot.space.nominal)
        rows = [
            row("published, without Coulomb", SimConfig(robot.hash, robot.name, nominal)),
            row("calibrated, without Coulomb", stored(made[0]["found"].calibrated_simulator)),
        ]
        for one in made:
            found = one["found"]
            rows.append(row(one["model"], stored(found.extended_simulator)) | {"seconds": one["seconds"]})
            rows[-1] |= {"named": ", ".join(c.key for c in found.causes), "diagnosis": _told(found)}
        for peer in peers(robot, recording):
            rows.append({"model": peer.name, **scores(peer.run, robot, recording), "seconds": peer.seconds})
            rows[-1] |= {"named": peer.named, "values": peer.values}
    report(rows)


def _told(found) -> dict:
    return {
        "verdict": found.verdict,
        "causes": [
            {
                "key": c.key,
                "nats": c.evidence_nats,
                **{k: [v.value, v.low, v.high, v.unit] for k, v in c.parameters.items()},
            }
            for c in found.causes
        ],
        "parameters": {k: v.value for k, v in found.parameters.items()},
        "ranking": [[r.round, r.key, r.score_nats] for r in found.ranking],
    }


def report(rows: list[dict]) -> None:
    """Print the causes and the table, and keep both."""
    for r in rows:
        for cause in r.get("diagnosis", {}).get("causes", []):
            sizes = [f"{k} {v[0]:.4g} ({v[1]:.4g} to {v[2]:.4g}) {v[3]}" for k, v in list(cause.items())[2:]]
            print(f"{r['model']}: {cause['key']}, {', '.join(sizes)}; {cause['nats']:.0f} nats")
    print(f"\n{'':31s} {'force':>7s} {'1 s':>8s} {'seconds':>9s}")
    for r in rows:
        print(
            f"{r['model']:31s} {100 * r['force']:5.1f} % {r['rollout_mm']:5.2f} mm {r.get('seconds', 0):9.1f}"
            f"   {r.get('named', '')[:150]}"
        )
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "diagnose_emps.json").write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
