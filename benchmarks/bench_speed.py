"""Speed on this machine: populate, physics as a share of a bare MuJoCo batch loop, query, peak memory."""

import argparse
import json
import os
import resource
import shutil
import time
from pathlib import Path

import numpy as np
from hidden import hidden_robots
from mujoco.batch import Batch

import dynreg
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

HERE = Path(__file__).parent
SEED = 41


def physics(name: str = "quadruped", simulators: int = 100, rounds: int = 3) -> dict[str, float]:
    """Physics steps/s of the engine and of a bare batch loop with the same model, commands and steps a command.

    Both run 20 episodes of each simulator at once, every simulator nominal, and are timed in turn; the best of
    each counts. The bare loop has no law of a drive but MuJoCo's own.
    """
    robot = load_robot(name)
    bank = excitation(robot, seed=SEED)
    substeps = round(1.0 / (robot.rate * robot.file.robot.timestep))
    values = np.tile(robot.space.nominal, (simulators, 1))
    run = Run(bank.actions, period=substeps * robot.file.robot.timestep)
    ours, bare = [], []
    for _ in range(rounds):
        began = time.perf_counter()
        done = rollout(robot, values, run)
        ours.append(done.physics_steps / (time.perf_counter() - began))
        bare.append(_bare(robot, bank.actions, simulators, substeps))
    return {"engine": max(ours), "bare": max(bare), "share": max(ours) / max(bare)}


def _bare(robot, actions: np.ndarray, simulators: int, substeps: int) -> float:
    """Steps/s of a loop that does nothing but write controls, step and keep the state."""
    episodes, steps, _ = actions.shape
    batch = Batch(robot.model, simulators * episodes)
    batch.reset(keyframe=0)
    ctrl, qpos, qvel = batch.bind("ctrl"), batch.bind("qpos"), batch.bind("qvel")
    commands = np.tile(actions, (simulators, 1, 1))
    trace = np.empty((steps, batch.nsim, robot.model.nq + robot.model.nv))
    batch.step(nstep=75)
    began = time.perf_counter()
    for t in range(steps):
        ctrl[:] = commands[:, t]
        batch.step(nstep=substeps)
        trace[t, :, : robot.model.nq], trace[t, :, robot.model.nq :] = qpos, qvel
    return batch.nsim * steps * substeps / (time.perf_counter() - began)


def main() -> None:
    """Print the table and write benchmarks/results/speed.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--registry", default=str(HERE / "registry-speed"))
    given = parser.parse_args()
    shutil.rmtree(given.registry, ignore_errors=True)
    out: dict[str, float] = {"cores": os.cpu_count() or 0}
    for name in ("quadruped", "aibo"):
        steps = physics(name)
        out |= {f"physics steps/s of {name}, {k}": steps[k] for k in ("engine", "bare")}
        out[f"physics share of bare loop, {name} (wanted: 0.85)"] = steps["share"]
    with dynreg.open(given.registry) as reg:
        summary = reg.populate("quadruped", given.entries)
        out["populate and link [s] (wanted: 180)"] = summary.seconds
        out["  simulate [s]"] = summary.simulate_seconds
        out["  train, base model included [s]"] = summary.train_seconds
        out["  link [s]"] = summary.link_seconds
        robot = load_robot("quadruped")
        hidden = hidden_robots(robot, 1, SEED)[0]
        log = hidden.log(excitation(robot, seed=SEED, name="own"), "log")
        recording = reg.ingest(log, robot, name="hidden")
        reg.query(recording)  # the population is read and torch warmed up once a session
        for label, options in (
            ("query without replay [s] (wanted: 0.3)", {"replay": False, "synthesise": False}),
            ("query with replay and synthesis [s] (wanted: 4)", {}),
        ):
            seconds = []
            for _ in range(3):
                began = time.perf_counter()
                reg.query(recording, **options)
                seconds.append(time.perf_counter() - began)
            out[label] = float(np.median(seconds))
    out["peak memory [GB] (wanted: 3)"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    for name, value in out.items():
        print(f"{name:50s} {value:12.3f}")
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / "speed.json").write_text(json.dumps(out, indent=1) + "\n")
    shutil.rmtree(given.registry, ignore_errors=True)


if __name__ == "__main__":
    main()
