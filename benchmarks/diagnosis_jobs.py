"""The jobs of `bench_diagnose_speed.py`: logs of real and simulated robots, and what is asked of them.

A job is plain JSON that `timed_diagnosis.py` reads: a robot, logs, and diagnoses of them; or a robot, commands, and
the widths and effects at which an engine's rate is told. Its files lie in one folder, made once for all checkouts.
Robots, commands and hidden effects are those of the naming benchmarks' development.
"""

import argparse
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from leg_trials import drawn
from leg_trials import plan_of as leg_plan
from measured_quadruped import measured
from naming import TUNE, seeds
from quadruped_trials import hidden as hidden_quadrupeds
from quadruped_trials import plan_of as quadruped_plan
from timed_diagnosis import write_log

import dynreg
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.truth import Protocol, hide, log_of, protocol
from dynreg.sim.effects import term
from dynreg.sim.robot import Robot, load_robot

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
RUNS = 20  # robots without an effect, for a threshold
ON_SERVO = (("backlash", "strong"), ("stribeck_load_friction", "medium"), ("voltage_sag", "strong"))
WIDTHS = (1, 16, 57, 672, 2000)  # candidates at once
ACTING = ("stribeck_load_friction", "command_delay", "speed_limit", "backlash")  # in four places
STEPS = 100  # commands of a rollout whose rate is told
ROUNDS = 2  # of rates; the best counts


def jobs(folder: Path, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """What a process does, one after the other; logs and robots lie in `folder`, made once for all checkouts."""
    makers = {
        "XL330": real_jobs,
        "servo": servo_jobs,
        "leg in the air": leg_jobs,
        "leg on the ground": leg_jobs,
        "quadruped": quadruped_jobs,
        "rates": rate_jobs,
    }
    for name, made in makers.items():
        asked = given.only is None or any(name.startswith(o) for o in given.only)
        if asked and not (given.quick and name == "quadruped"):
            yield from made(name, folder, given)


def real_jobs(name: str, folder: Path, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The real XL330, without a threshold, and with one that is sought, then kept."""
    logs = sorted((DATA / "bam_xl330_pendulum" / "raw").glob("*.json"))
    if not logs:
        print("XL330: skipped, no log of it in DYNREG_DATA_DIR")
        return
    with tempfile.TemporaryDirectory() as registry, dynreg.open(registry) as reg:
        recording = reg.recording(reg.ingest(logs, "servo_pendulum").recording)
    write_log(recording, folder / "xl330.npz")
    job = _job("servo_pendulum", ["xl330.npz"], [recording.id], "kp=400", 5.0)
    yield job | {"asks": [_ask(name)]}
    if not given.quick:
        asks = [_ask(f"{name}, threshold {how}", threshold_runs=RUNS) for how in ("sought", "kept")]
        yield job | {"asks": asks}


def servo_jobs(name: str, folder: Path, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Simulated servo benches under the same commands in one registry, each diagnosed twice."""
    robot = load_robot("servo_pendulum")
    plan = protocol(robot, seed=TUNE)
    trials = [(k, s, n) for (k, s), n in zip(ON_SERVO, seeds(TUNE, "speed", n=9), strict=False)]
    job = _simulated(robot, "servo_pendulum", plan, trials[: given.logs], folder / "servo", engine="mujoco")
    asks = []
    for i, (key, size, _) in enumerate(trials[: given.logs]):
        how = {"log": i, "hides": f"{key} {size}", "threshold_runs": RUNS, "max_causes": 1}
        first = "next recording of the same commands" if i else "threshold sought"
        asks += [_ask(f"{name}, {first}", **how), _ask(f"{name}, threshold kept", **how)]
    yield job | {"asks": asks}


def leg_jobs(name: str, folder: Path, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Legs in the air or on the ground; what they hide is drawn as in the naming benchmark."""
    robot, where = load_robot("leg"), name.split()[-1]
    plan = leg_plan(robot, where)
    for i, trial in enumerate(drawn(robot, where, given.logs, TUNE)):
        yield _alone(name, robot, "leg", plan, trial, folder / f"leg_{where}_{i}")


def quadruped_jobs(name: str, folder: Path, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Quadrupeds that stand and trot, as the naming benchmark knows them; another effect each."""
    packaged = load_robot("quadruped")
    robot = load_robot(write_robot(measured(packaged), folder / "measured"))
    plan = quadruped_plan(robot)
    for i, trial in enumerate(hidden_quadrupeds(robot, 1, TUNE)[: given.logs]):
        yield _alone(name, robot, "measured", plan, trial, folder / f"quadruped_{i}")


def rate_jobs(name: str, folder: Path, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The engines of the servo bench and of the leg: so many candidates, so many effects between them."""
    for robot, engine in (("servo_pendulum", "joint"), ("leg", "mujoco")):
        own = load_robot(robot)
        plan = protocol(own, seed=TUNE)
        path = f"{robot}_commands.npz"
        np.savez(folder / path, actions=plan.run.actions[:1, :STEPS], period=plan.run.period)
        every = [t.key for t in single_terms(own) if not t.joints]
        sized = {k: hide(own, (term(k),), "medium", TUNE).values[0].tolist() for k in (*every, *ACTING)}
        some = ((), ACTING[:1], ACTING, every)
        widths = WIDTHS[:-1] if given.quick and engine == "mujoco" else WIDTHS
        for number in range(ROUNDS):
            yield {
                "robot": robot,
                "engine": engine,
                "commands": path,
                "widths": widths,
                "effects": [[(k, sized[k]) for k in keys] for keys in some],
                "round": number,
            }


def write_robot(robot: Robot, folder: Path) -> Path:
    """A robot folder: the robot's own, with its parameters' nominal values and tolerances and its channels' weights."""
    shutil.copytree(robot.folder, folder)
    path = folder / "robot.toml"
    own = {
        ("parameters", p.name): {"nominal": p.nominal, "tolerance": p.tolerance}
        for p in robot.space.parameters
    }
    own |= {("channels", c.name): {"weight": c.weight} for c in robot.file.channels}
    tables = re.split(r"(?m)^(?=\[)", path.read_text(encoding="utf-8"))
    for i, table in enumerate(tables):
        found = re.match(r'\[\[(\w+)\]\].*\nname = "(.+)"', table)
        for key, value in own.get(found.groups(), {}).items() if found else ():
            line = f"{key} = {float(value)!r}\n"
            table, many = re.subn(rf"(?m)^{key} = .*\n", line, table)
            tables[i] = table = table if many else table.replace("\n", f"\n{line}", 1)
    path.write_text("".join(tables), encoding="utf-8")
    return folder


def _alone(name: str, robot: Robot, ref: str, plan: Protocol, trial: tuple, path: Path) -> dict[str, Any]:
    """The job of one simulated robot whose threshold is known."""
    hides = " ".join(trial[:2])
    return _simulated(robot, ref, plan, [trial], path) | {"asks": [_ask(name, hides=hides, max_causes=1)]}


def _simulated(
    robot: Robot,
    ref: str,
    plan: Protocol,
    trials: Sequence[tuple[str, str, int]],
    path: Path,
    engine: str | None = None,
) -> dict[str, Any]:
    """A job, yet without what is asked, about logs of robots that hide an effect: (key, size, seed) of each."""
    logs, ids = [], []
    for i, (key, size, seed) in enumerate(trials):
        recording = log_of(robot, hide(robot, (term(key),), size, seed), plan, engine=engine)
        logs.append(f"{path.name}_{i}.npz")
        write_log(recording, path.with_name(logs[-1]))
        ids.append(recording.id)
    return _job(ref, logs, ids, ",".join(n for n in plan.names if n.startswith("test")), 1.0)


def _job(robot: str, logs: list[str], ids: list[str], hold_out: str, tolerance: float) -> dict[str, Any]:
    return {"robot": robot, "logs": logs, "recordings": ids, "hold_out": hold_out, "tolerance": tolerance}


def _ask(
    case: str, log: int = 0, hides: str = "", threshold_runs: int = 0, **settings: int
) -> dict[str, Any]:
    return {
        "case": case,
        "log": log,
        "hides": hides,
        "settings": {"threshold_runs": threshold_runs, **settings},
    }
