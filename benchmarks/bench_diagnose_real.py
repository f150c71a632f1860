"""Diagnoses of real robots in one table: verdict, known answer, held-out error beside its rivals', seconds.

Every bench is a robot that others measured, the diagnosis as docs/data.md asks for it, and what is known of the robot.
The error is one for all: mean absolute error of the positions of joints (of a planar base: x and y) over the windows
that the diagnosis holds out. Beside the nominal, the calibrated and the unpenalised simulator stand a robot that holds
still or just follows its commands ("baseline": the better one), mujoco.sysid and sparse regression ("peer": the better
one) and CMA-ES, each told what to free; they see the same windows.

Done steps are kept in a journal: a second start goes on. `make bench-diagnose_real ARGS="--only emps go2_stand"`.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bench_diagnose_create as create
import bench_diagnose_double_pendulum as double
import bench_diagnose_emps as emps
import bench_diagnose_servo as servo
import bench_diagnose_simple_pendulum as simple
import bench_diagnose_so101 as arm
import numpy as np
from journal import Journal
from kept import RESULTS
from open_loop import Segments, simulated
from servo_peers import PLACES, Peer, identify, missed, searched

import dynreg
from dynreg.data.recording import Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.evidence.data import Data
from dynreg.evidence.model import Model
from dynreg.results.diagnosis import Diagnosis, RolloutError
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.verbs.robot_draft import RobotDraftSettings, robot_draft
from dynreg.verbs.subjects import Recorded, robot_of

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
MAPS = HERE.parent / "examples" / "maps"
FILE = RESULTS / "diagnose_real.json"
JOURNAL = RESULTS / "diagnose_real.jsonl"
MODELS = ("nominal", "calibrated", "unpenalised", "extended", "held", "followed")
BUDGET = 1000  # simulations of CMA-ES: ten and more for each parameter that any of them frees
NEAR = 0.15  # share by which a friction of the TX40 may miss its known value: by contract
COULOMB = (7.14, 8.26, 6.34, 2.48)  # N m, joints 1 to 4 of the TX40, from its source's configuration
VISCOUS = (8.05, 5.53, 1.97, 1.11)  # N m s/rad
WRIST = ("joint_5", "joint_6")  # which one motor of the TX40 turns together
GO2_HELD = ("cycle_3", "cycle_6", "cycle_9", "cycle_12")
LEGS = ("FL", "FR", "RL", "RR")


@dataclass(frozen=True)
class Known:
    """What is known of a robot, what was found, and whether that agrees."""

    what: str
    true: str
    found: str
    holds: bool


@dataclass(frozen=True)
class Seen:
    """A finished diagnosis, with what it was about. simulators : {model: configuration}, those that it left."""

    robot: Robot
    recording: Recording
    found: Diagnosis
    simulators: dict[str, SimConfig]

    @property
    def keys(self) -> tuple[str, ...]:
        """The causes, as they are named."""
        return tuple(c.key for c in self.found.causes)

    @property
    def best(self) -> SimConfig:
        """The simulator that it leaves."""
        return self.simulators.get("extended", self.simulators["calibrated"])

    def size(self, key: str, parameter: str) -> float:
        """A size of a cause; 0 where it is none."""
        return next((c.parameters[parameter].value for c in self.found.causes if c.key == key), 0.0)


@dataclass(frozen=True)
class Bench:
    """A robot that others measured.

    folder : of `DATA`. read : ingests it; the recording. options : of the diagnosis. known : what it should find.
    told : terms that CMA-ES frees beside the robot's parameters. peers : tools beside it, on the diagnosis' windows.
    """

    folder: str
    read: Callable[[Any, Path, Path], str]
    options: dict[str, Any]
    known: Callable[[Seen], list[Known]]
    told: tuple[str, ...] = ()
    peers: Callable[[Model, Data, Seen], Iterator[Peer]] = field(default=lambda *_: iter(()))


def read_servo(reg, folder: Path, _work: Path) -> str:
    """The XL330 on its bench, with the measured supply."""
    return reg.ingest(sorted((folder / "raw").glob("*.json")), "servo_pendulum", name="servo").recording


def known_servo(seen: Seen) -> list[Known]:
    """The published ladder's best rungs hold friction that grows with the load."""
    load = next((k for k in seen.keys if "load_friction" in k), "")
    return [Known("friction with load", "load or Stribeck x load", load or "not named", bool(load))]


def peers_servo(model: Model, data: Data, _seen: Seen) -> Iterator[Peer]:
    """mujoco.sysid."""
    yield from _identified(model, data)


def read_emps(reg, folder: Path, _work: Path) -> str:
    """The positioning system, both files."""
    return reg.ingest(sorted(folder.glob("*.mat")), "emps", name="emps").recording


def known_emps(seen: Seen) -> list[Known]:
    """Published dry friction and offset, and the open-loop error of 1 s in the source's own measure."""
    dry = seen.size("coulomb_friction", "torque")
    errors = {n: emps.scores(_run(seen, c), seen.robot, seen.recording) for n, c in seen.simulators.items()}
    last = errors.get("extended", errors["calibrated"])
    return [
        Known("dry friction [N]", "20.4", f"{dry:.1f}", bool(abs(dry - 20.4) < 0.1 * 20.4)),
        Known("force error", "6.5 %", f"{100 * last['force']:.1f} %", last["force"] < 0.065),
        Known("open loop, 1 s [mm]", "2.17", f"{last['rollout_mm']:.2f}", last["rollout_mm"] < 2.17),
    ]


def peers_emps(_model: Model, data: Data, seen: Seen) -> Iterator[Peer]:
    """mujoco.sysid, told what to free, and sparse regression."""
    yield from _on_windows(emps.peers(seen.robot, seen.recording), data, seen.robot)


def read_double(reg, folder: Path, _work: Path) -> str:
    """The double pendulum, the swing-ups last."""
    logs = sorted(folder.glob("*.parquet"), key=lambda log: (log.stem in double.HELD_OUT, log.stem))
    return reg.ingest(logs, "double_pendulum", name="double").recording


def known_double(seen: Seen) -> list[Known]:
    """Dry friction of both joints, the rotors' inertia, and the median windows of the source's own measure."""
    scores = double.scores(_run(seen, seen.best), seen.robot, seen.recording)
    both = seen.size("coulomb_friction", "torque")
    dry = [both + seen.size(f"coulomb_friction[{j}]", "torque") for j in double.JOINTS]
    rotor = next((k for k in seen.keys if k.startswith("inertia")), "")
    half, whole = scores["median 0.5 s"], scores["median 1 s"]
    return [
        Known("dry friction [N m]", "0.26, 0.18", ", ".join(f"{d:.2f}" for d in dry), min(dry) > 0.1),
        Known("rotor inertia", "named", rotor or "not named", bool(rotor)),
        Known("median window, 0.5 s [rad]", "0.034", f"{half:.3f}", half < 0.0345),
        Known("median window, 1 s [rad]", "0.051", f"{whole:.3f}", whole < 0.0515),
    ]


def peers_double(_model: Model, data: Data, seen: Seen) -> Iterator[Peer]:
    """mujoco.sysid, told what to free, and sparse regression."""
    train = [e.name for e in seen.recording.episodes if e.name not in double.HELD_OUT]
    yield from _on_windows(double.peers(seen.robot, seen.recording, train), data, seen.robot)


def read_simple(reg, folder: Path, _work: Path) -> str:
    """The simple pendulum with about 0.4 kg more at its bob."""
    logs = [folder / f"control_method_{simple.RUNS[1]}_{part}.csv" for part in ("measured", "desired")]
    return reg.ingest(logs, "simple_pendulum", name="swing").recording


def known_simple(seen: Seen) -> list[Known]:
    """These data do not tell the bob's mass: the interval must hold the true one, and the rival must be told."""
    low, high = (simple.BOB * end for end in simple.interval(seen.found)["reported"])
    apart = ", ".join(p.between[1] for p in seen.found.inseparable)
    holds = low <= simple.TRUE_DIFFERENCE <= high
    return [
        Known("payload [kg]", "0.4", f"{low:.2f} to {high:.2f}", holds),
        Known("cannot be told from", "friction or drive", apart or "nothing", bool(apart)),
    ]


def peers_simple(model: Model, data: Data, _seen: Seen) -> Iterator[Peer]:
    """mujoco.sysid."""
    yield from _identified(model, data)


def read_create(reg, folder: Path, _work: Path) -> str:
    """The Create, its second half held out."""
    logs = sorted(folder.glob("*.parquet"))
    identity = reg.ingest(logs, "create", name="whole").recording
    robot = robot_of(reg.registry, identity)
    return reg.registry.put_recording(create.halves(reg.registry.recording(identity)), robot.hash)


def known_create(seen: Seen) -> list[Known]:
    """What simple means over the log say: the path is shorter and the turn later than commanded."""
    segments = Segments.cut(seen.robot, seen.recording, [create.HALVES[1]], create.ROLLOUT, create.EVERY)
    measured = create.simple(segments.measured, segments)
    made = create.simple(simulated(seen.robot, seen.best, segments), segments)
    # how near counts: by contract
    told = (("path", "of the commanded", 0.03), ("slope", "of the commanded yaw rate", 0.05))
    out = [
        Known(
            f"{k}, {what}",
            f"{measured[k]:.3f}",
            f"{made[k]:.3f}",
            abs(made[k] - measured[k]) < most,
        )
        for k, what, most in told
    ]
    late = abs(made["lag"] - measured["lag"]) < 0.05
    return [*out, Known("lag [s]", f"{measured['lag']:.2f}", f"{made['lag']:.2f}", late)]


def read_go2(reg, folder: Path, work: Path) -> str:
    """The Go2 on its stand, drafted from its model and log."""
    log = folder / "traj_0.parquet"
    draft = RobotDraftSettings(to=work / "go2_stand", kp="20", kd="1.5")
    robot_draft(folder / "go2_stand.xml", log, draft)
    return reg.ingest([log], work / "go2_stand", log_map=MAPS / "go2_stand.toml", name="go2").recording


def known_go2(seen: Seen) -> list[Known]:
    """Friction of the calves, and one closed-loop rollout of the whole log, as its source judges it."""
    hip, calf = (_friction(seen, part) for part in ("hip", "calf"))
    nominal, best = (free_run(seen, c) for c in (seen.simulators["nominal"], seen.best))
    return [
        Known("calf over hip friction", "3 to 5", f"{calf / hip:.1f}", 3.0 <= calf / hip <= 5.0),
        Known("23.5 s [rad]", "0.0070; nominal 0.0125", f"{best:.4f}; nominal {nominal:.4f}", best <= 0.0070),
    ]


def _friction(seen: Seen, part: str) -> float:
    """Mean dry friction of a kind of joint, of the robot's own parameter and of the causes [N m]."""
    joints = [f"{leg}_{part}_joint" for leg in LEGS]
    own = seen.best.values[f"{part}_friction"] + seen.size("coulomb_friction", "torque")
    return own + float(np.mean([seen.size(f"coulomb_friction[{j}]", "torque") for j in joints]))


def free_run(seen: Seen, config: SimConfig) -> float:
    """Mean absolute error of the joints' positions in the held-out cycles, of one rollout from the log's first row."""
    robot, recording = seen.robot, seen.recording
    values = np.concatenate([e.values for e in recording.episodes])
    owner = np.concatenate([[e.name in GO2_HELD] * len(e.time) for e in recording.episodes])
    states, actions = recording.columns(robot.channels), recording.columns(robot.actions)
    run = Run(values[None, :-1, actions], initial=values[:1, states], period=1.0 / robot.rate)
    parameters = robot.space.from_dict(dict(config.values))[None]
    made = rollout(robot, parameters, run, threads=1, terms=terms_of(config, robot)).states[0, 0]
    count = len(robot.driven)
    return float(np.nanmean(np.abs(made - values[:, states])[owner, :count]))


def peers_go2(model: Model, data: Data, _seen: Seen) -> Iterator[Peer]:
    """mujoco.sysid."""
    yield from _identified(model, data)


def read_tx40(reg, folder: Path, work: Path) -> str:
    """The TX40, drafted from its model and log."""
    log = folder / "run_500hz.parquet"
    robot_draft(folder / "tx40.xml", log, RobotDraftSettings(to=work / "tx40"))
    return reg.ingest([log], work / "tx40", log_map=MAPS / "tx40.toml", name="tx40").recording


def known_tx40(seen: Seen) -> list[Known]:
    """Frictions of joints 1 to 4, and that joints 5 and 6 hang together."""
    out = []
    for what, effect, size, true in (
        ("friction", "coulomb_friction", "torque", COULOMB),
        ("damping", "viscous_friction", "coefficient", VISCOUS),
    ):
        found = [
            seen.best.values[f"joint_{j}_{what}"]
            + seen.size(effect, size)
            + seen.size(f"{effect}[joint_{j}]", size)
            for j in range(1, len(true) + 1)
        ]
        miss = np.abs(np.array(found) / true - 1)
        out.append(Known(f"{what}, joints 1 to 4", _row(true), _row(found), bool((miss <= NEAR).all())))
    wrist = f"cable_coupling[{','.join(WRIST)}]"
    said = "named" if wrist in seen.keys else "not named"
    return [*out, Known("the wrist's coupling", wrist, said, wrist in seen.keys)]


def _row(values: Sequence[float]) -> str:
    return " ".join(f"{v:.2f}" for v in values)


def peers_tx40(model: Model, data: Data, _seen: Seen) -> Iterator[Peer]:
    """mujoco.sysid."""
    yield from _identified(model, data)


BENCHES = {
    "servo": Bench(
        "bam_xl330_pendulum",
        read_servo,
        {"hold_out": "kp=400", "tolerance": servo.TOLERANCE},
        known_servo,
        ("stribeck_load_friction",),
        peers_servo,
    ),
    "emps": Bench(
        "emps",
        read_emps,
        {"hold_out": emps.TEST, "without": emps.SAME},
        known_emps,
        ("coulomb_friction", "force_offset"),
        peers_emps,
    ),
    "double_pendulum": Bench(
        "dfki_double_pendulum",
        read_double,
        {"hold_out": ",".join(double.HELD_OUT), "without": double.RULED_OUT, "windows": 32},
        known_double,
        (*(f"{e}[{j}]" for e in ("coulomb_friction", "viscous_friction") for j in double.JOINTS), "inertia"),
        peers_double,
    ),
    "simple_pendulum": Bench(
        "dfki_simple_pendulum",
        read_simple,
        {"effects": ("payload",), "engine": "joint", "horizon": simple.HORIZON},
        known_simple,
        ("payload",),
        peers_simple,
    ),
    "create": Bench(
        "utias_mrclam",
        read_create,
        {"hold_out": create.HALVES[1]},
        known_create,
        ("turn_slowdown", "drive_inertia"),
    ),
    "tx40": Bench(
        "tx40",
        read_tx40,
        {"max_causes": 5},  # three rotors that the draft lacks, and the wrist
        known_tx40,
        (*(f"inertia[joint_{j}]" for j in range(1, 5)), "cable_coupling[joint_5,joint_6]"),
        peers_tx40,
    ),
    "go2_stand": Bench(
        "go2_stand",
        read_go2,
        {"hold_out": ",".join(GO2_HELD), "windows": 6, "max_causes": 1},
        known_go2,
        (),
        peers_go2,
    ),
}
ARM = "so101"


def _run(seen: Seen, config: SimConfig) -> Callable[[Segments], np.ndarray]:
    return lambda segments: simulated(seen.robot, config, segments)


def _identified(model: Model, data: Data) -> Iterator[Peer]:
    peer = identify(model, data, data.parts.chosen, judged(data))
    if peer is not None:
        yield peer


def _on_windows(peers: Sequence[Any], data: Data, robot: Robot) -> Iterator[Peer]:
    """Fitted MuJoCo models, judged on the windows of the diagnosis."""
    for one in peers:
        errors = []
        for chosen in (data.parts.chosen, judged(data)):
            cut = data.windows.take(chosen)
            made = one.run(Segments(cut.measured, cut.run.actions, cut.period))
            errors.append(float(missed(robot, data, made[None], chosen)[0]))
        yield Peer(one.name, *errors, 0, one.seconds)


def judged(data: Data) -> np.ndarray:
    """Numbers of the windows that errors are of: the test part; without one the select part."""
    parts = data.parts
    return np.flatnonzero(parts.test if parts.test.any() else parts.select)


def placed(error: RolloutError) -> bool:
    """Whether an error is of a channel that says where the robot is; see `servo_peers.positions`."""
    return error.channel.rsplit("/", 1)[-1] in PLACES


def errors_told(errors: Sequence[RolloutError]) -> dict[str, float | None]:
    """{model: mean over the position channels}, as a diagnosis tells them; None where a channel has none."""
    rows = [e for e in errors if placed(e)]
    out: dict[str, float | None] = {}
    for model in MODELS:
        values = [getattr(e, model) for e in rows]
        out[model] = None if None in values else float(np.mean(values))
    return out


def diagnosed(bench: Bench, given: argparse.Namespace, work: Path) -> Iterator[tuple[str, dict]]:
    """(step, line) of one bench: its diagnosis, its peers, CMA-ES. Only what `given.done` lacks is computed."""
    with dynreg.open(work / "registry") as reg:
        identity = bench.read(reg, DATA / bench.folder, work)
        robot, recording = robot_of(reg.registry, identity), reg.registry.recording(identity)
        options = {"threshold_runs": 0} | bench.options
        lacks = [step for step in ("diagnosis", "peers", "cmaes") if step not in given.done]
        if "diagnosis" in lacks:
            found = reg.diagnose(identity, threads=1, **options)
            stored = {k: getattr(found, f"{k}_simulator") for k in ("calibrated", "extended")}
            simulators = {k: reg.registry.simulator(i) for k, i in stored.items() if i}
            line = {"document": found.to_dict(), "simulators": simulators}
            yield "diagnosis", line
            given.done["diagnosis"] = line
        seen = _seen(robot, recording, given.done["diagnosis"])
        yield "known", {"known": [vars(k) for k in bench.known(seen)], **told(seen)}
        asked = DiagnosisOptions(**{"threads": 1} | options)
        model, data = pose(robot, recording, asked)
        if "peers" in lacks:
            yield "peers", {"peers": [vars(p) for p in bench.peers(model, data, seen)]}
        if "cmaes" in lacks:
            one = searched(
                model, data, bench.told, data.parts.chosen, judged(data), seed=0, budget=given.budget
            )
            yield "cmaes", {"cmaes": vars(one)}


def _seen(robot: Robot, recording: Recording, line: dict) -> Seen:
    """What a line of the journal says."""
    simulators = {"nominal": SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal))}
    simulators |= {k: SimConfig.from_dict(v) for k, v in line["simulators"].items()}
    return Seen(robot, recording, Diagnosis.model_validate(line["document"]), simulators)


def told(seen: Seen) -> dict:
    """What the table shows of a diagnosis."""
    found = seen.found
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "causes": {
            c.key: {
                "nats": c.evidence_nats,
                **{k: [v.value, v.low, v.high, v.unit] for k, v in c.parameters.items()},
            }
            for c in found.causes
        },
        "doubts": [d.to_dict() for d in found.doubts],
        "unit": next(e.unit for e in found.errors if placed(e)),
        "errors": errors_told(found.errors),
        "seconds": found.cost.seconds,
    }


def of_arm(given: argparse.Namespace) -> Iterator[tuple[str, dict]]:
    """(step, line) of the SO-101, joint by joint in lockstep; CMA-ES is its plain servo with delay."""
    logs = sorted((DATA / "sage_so101_arm").glob("*.parquet"))
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        identity = reg.ingest(logs, "so101", name="arm").recording
        asked = Recorded(
            reg.registry, robot_of(reg.registry, identity), reg.registry.recording(identity), ARM
        )
        if "joints" not in given.done:
            how = argparse.Namespace(
                joints=list(arm.JOINTS), windows=arm.WINDOWS, max_causes=given.arm_causes, budget=given.budget
            )
            rows = dict(arm.rows_of(asked, how))
            yield "joints", {"joints": rows}
            given.done["joints"] = {"joints": rows}
        rows = given.done["joints"]["joints"]
        whole = {
            engine: arm.whole_errors(asked.robot, asked.recording, rows, engine)
            for engine in ("joint", "mujoco")
        }
        yield "known", {**told_arm(rows, whole), "whole": whole}


def _mean(errors: dict, model: str) -> float:
    """Over joints and motions [rad]."""
    return float(np.mean([list(errors[j][model].values()) for j in arm.JOINTS]))


def told_arm(rows: dict, whole: dict) -> dict:
    """What the table shows of the SO-101: means over its joints."""
    short = {j: rows[j]["errors"] for j in arm.JOINTS}
    alone, together = (_mean(whole[engine], "extended") for engine in ("joint", "mujoco"))
    plain = _mean(whole["mujoco"], "plain")
    known = Known(
        "all joints in MuJoCo [rad]", f"{alone:.4f} joint by joint", f"{together:.4f}", together < 1.1 * alone
    )
    better = Known(
        "all joints in MuJoCo [rad]",
        f"under the plain servos' {plain:.4f}",
        f"{together:.4f}",
        together < plain,
    )
    rubs = [j for j in arm.JOINTS if any("friction" in c["key"] for c in rows[j]["causes"])]
    dry = Known(
        "dry friction", "every joint", f"{len(rubs)} of {len(arm.JOINTS)}", len(rubs) == len(arm.JOINTS)
    )
    return {
        "verdict": ", ".join(sorted({rows[j]["verdict"] for j in arm.JOINTS})),
        "causes": {c["key"]: {"nats": c["nats"]} for j in arm.JOINTS for c in rows[j]["causes"]},
        "known": [vars(k) for k in (dry, known, better)],
        "unit": "rad",
        "errors": {m: _mean(short, m) for m in ("calibrated", "extended")},
        "cmaes": {
            "held_out": _mean(short, "plain"),
            "seconds": sum(rows[j]["seconds"]["plain"] for j in arm.JOINTS),
        },
        "seconds": sum(rows[j]["seconds"]["diagnosis"] for j in arm.JOINTS),
    }


def main() -> None:
    """Print the table and write benchmarks/results/diagnose_real.json."""
    given = _arguments()
    journal = Journal(given.journal, {"budget": given.budget, "arm_causes": given.arm_causes})
    journal.begin()
    for name in given.only:
        if not (DATA / (BENCHES[name].folder if name in BENCHES else "sage_so101_arm")).is_dir():
            print(f"{name}: skipped, no log of it in DYNREG_DATA_DIR")
            continue
        began = time.perf_counter()
        given.done = {line["step"]: line for line in journal.lines() if line["bench"] == name}
        if (
            given.table
            or {"known", "peers", "cmaes"} <= {*given.done}
            or {"joints", "known"} <= {*given.done}
        ):
            continue
        with tempfile.TemporaryDirectory() as work:
            steps = of_arm(given) if name == ARM else diagnosed(BENCHES[name], given, Path(work))
            for step, line in steps:
                journal.add({"bench": name, "step": step, **line})
                print(f"{name}: {step}, {time.perf_counter() - began:.0f} s", flush=True)
    rows = merged(journal.lines())
    if rows:
        report(rows)
        FILE.write_text(json.dumps(rows, indent=1) + "\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    names = [*BENCHES, ARM]
    parser.add_argument("--only", nargs="*", default=names, choices=names, help="these benches [all]")
    parser.add_argument("--journal", type=Path, default=JOURNAL)
    parser.add_argument("--table", action="store_true", help="print what the journal holds, compute nothing")
    parser.add_argument("--budget", type=int, default=BUDGET, help="simulations of CMA-ES")
    parser.add_argument("--arm-causes", type=int, default=4, help="most causes of each joint of the SO-101")
    return parser.parse_args()


def merged(lines: Sequence[dict]) -> dict[str, dict]:
    """{bench: row}: what the table shows, of all steps of a bench; the last line of a step counts."""
    rows: dict[str, dict] = {}
    for line in lines:
        own = {
            k: v for k, v in line.items() if k not in ("bench", "step", "document", "simulators", "joints")
        }
        rows.setdefault(line["bench"], {}).update(own)
    return {name: row for name, row in rows.items() if "verdict" in row}


def least(*errors: float | None) -> float | None:
    """The least of those that are there."""
    return min((e for e in errors if e is not None), default=None)


def report(rows: dict[str, dict]) -> None:
    """Print the table and what is known of each robot."""
    columns = ("nominal", "calibrated", "unpenalised", "extended")
    heads = ("baseline", *columns, "best peer", "CMA-ES", "seconds")
    print(f"{'held-out error':16}{'':4}" + "".join(f"{c:>12}" for c in heads))
    for name, row in rows.items():
        plain = least(row["errors"].get("held"), row["errors"].get("followed"))
        peers = least(*(p["held_out"] for p in row.get("peers", ())))
        fitted = row.get("cmaes", {}).get("held_out")
        cells = [plain, *(row["errors"].get(c) for c in columns), peers, fitted]
        shown = "".join(f"{'-':>12}" if c is None else f"{c:12.5f}" for c in cells)
        print(f"{name:16}{row['unit']:4}{shown}{row['seconds']:12.0f}")
    for name, row in rows.items():
        causes = ", ".join(f"{k} ({c['nats']:.0f} nats)" for k, c in row["causes"].items())
        print(f"\n{name}: {row['verdict']}, {causes or 'no cause'}")
        for d in row.get("doubts", ()):
            print(f"  doubt: {d['kind']} {d['of']} {d['value']:.3g}")
        for k in row["known"]:
            print(f"  {'yes' if k['holds'] else 'NO '} {k['what']}: {k['found']} (known: {k['true']})")


if __name__ == "__main__":
    main()
