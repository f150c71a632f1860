"""How fast the engine steps, beside a bare batch loop of MuJoCo."""

import time

import numpy as np
from mujoco.batch import Batch

from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot
from dynreg.sim.run import Run

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
