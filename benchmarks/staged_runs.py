"""A staged calibration of a hidden AIBO by the paper's plans, and the errors of walks in its simulators."""

import argparse
import json
import time
import tomllib
from pathlib import Path

import aibo
import numpy as np

from dynreg.data.recording import Recording
from dynreg.methods.losses import mean_velocities
from dynreg.replay.data import data
from dynreg.replay.windows import Replayer
from dynreg.results import Calibration
from dynreg.session import Session
from dynreg.sim.robot import load_robot
from dynreg.sim.stand import on_stand

SKIP = 1.0  # s of a walk, as in the paper
UNITS = (("x", 1000.0, "mm/s"), ("y", 1000.0, "mm/s"), ("r", 180.0 / np.pi, "deg/s"))


def calibrated(
    session: Session, given: argparse.Namespace, hidden: aibo.Hidden
) -> tuple[dict[str, np.ndarray], int]:
    """{stage: (P,) parameters of aibo} of the nominal robot and after each stage; simulators that were run.

    The walks are recording "walks" of the session afterwards; those of group B are held out.
    """
    robot = load_robot("aibo")
    stand = on_stand(robot)
    names = aibo.logs(hidden, stand, fit=given.fit, held=given.held, air=given.air, walk=given.walk)
    session.ingest(names["air"], stand, name="air")
    for name in ("ground", "walks"):
        session.ingest(names[name], robot, name=name)
    found = {"initial": robot.space.nominal}
    held = ",".join(f"walks/{name}" for name in held_out(names["walks"]))
    told = {"method": "staged", "seed": hidden.seed, "threads": given.threads, "resume": given.resume}
    began = time.perf_counter()

    def after(result: Calibration) -> None:
        for version in result.versions:
            values = session.registry.simulator(version.simulator)["values"]
            found[version.stage] = robot.space.from_dict(robot.space.as_dict(robot.space.nominal) | values)
            print(f"{version.stage}: {version.before:.5g} -> {version.after:.5g}", flush=True)
        print(f"{result.cost.rollouts} simulators, {time.perf_counter() - began:.0f} s", flush=True)

    def plan(name: str) -> Path:
        stages = tomllib.loads((robot.folder / "plans" / f"{name}.toml").read_text(encoding="utf-8"))[
            "stages"
        ]
        for stage in stages:
            stage["generations"] = max(round(given.scale * stage["generations"]), 1)
        lines = ["\n".join(["[[stages]]", *(f"{k} = {json.dumps(v)}" for k, v in s.items())]) for s in stages]
        path = Path(session.registry.path) / f"{name}.toml"
        path.write_text("\n\n".join(lines), encoding="utf-8")
        return path

    air = session.calibrate("air", plan=plan("air"), robot=stand, hold_out="0", **told)
    after(air)
    last = session.calibrate(
        ["ground", "walks"], plan=plan("ground"), robot=robot, start=air.simulator, hold_out=held, **told
    )
    after(last)
    return found, air.cost.rollouts + last.cost.rollouts


def held_out(walks: Recording) -> list[str]:
    """Names of the walks of group B."""
    return [e.name for e in walks.episodes if e.name.startswith("B")]


def deviations(hidden: aibo.Hidden, session: Session, found: dict[str, np.ndarray], threads: int) -> dict:
    """{stage: {group: {axis: (standard deviation, largest, root mean square)}}}, and each walk's errors."""
    cut = data(
        load_robot("aibo"),
        session.registry.recording(session.registry.resolve("walks", ("recording",))[1]),
        "0",
    )
    rows = round(SKIP / cut.windows.period)
    every = np.arange(len(cut.windows))
    measured = cut.windows.measured[:, rows:]
    velocities = mean_velocities(cut)
    simulated = Replayer(cut.robot, cut.windows, threads).states(np.stack([*found.values()]), every)[
        :, :, rows:
    ]
    simulated = np.where(np.isfinite(measured).any(axis=-1)[..., None], simulated, np.nan)
    apart = velocities(simulated) - velocities(measured)  # (n, W, 3)
    names = [cut.recording.episodes[i].name for i in cut.windows.episode]
    groups = {g: np.array([n.startswith(g) for n in names]) for g in ("A", "B")}
    groups["A+B"] = groups["A"] | groups["B"]
    out: dict = {}
    for stage, errors in zip(found, apart, strict=True):
        out[stage] = {
            group: {
                axis: [
                    scale * float(of(errors[mask, i]))
                    for of in (np.nanstd, lambda e: np.nanmax(np.abs(e)), lambda e: np.sqrt(np.nanmean(e**2)))
                ]
                for i, (axis, scale, _) in enumerate(UNITS)
            }
            for group, mask in groups.items()
        }
    out["walks by"] = {
        name: np.round(row, 4).tolist() for name, row in zip(names, velocities(measured), strict=True)
    }
    return out
