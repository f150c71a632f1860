"""Gaits evaluated a second, as a share of what a bare `mujoco.batch.Batch` rollout of the same steps would do.

Both run the same joint commands of 10 s in the same number of simulators, k = 5 of them for each gait, timed in
turn; the median of the ratios counts. The bare batch knows no parameters, limits, falls or fitness.
"""

import argparse
import json
import time

import numpy as np
from kept import RESULTS
from mujoco.batch import Batch

from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream
from dynreg.sim.robot import load_robot

SUBSTEPS = 7  # of a command at 36 Hz


def main() -> None:
    """Measure, print, and keep the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    figures = [_share(gaits, given.rounds, given.seconds) for gaits in (5, 20)]
    for f in figures:
        print(
            f"{f['gaits']} gaits at a time in 5 simulators: {f['gaits_a_second']:.1f} gaits/s,"
            f" {f['steps_a_second']:.0f} steps/s, {f['share']:.2f} of a bare rollout (the best of both ways)"
        )
    (RESULTS / "gait_speed.json").write_text(json.dumps(figures, indent=1) + "\n")


def _share(gaits: int, rounds: int, seconds: float) -> dict[str, float]:
    robot = load_robot("quadruped")
    task = task_of(robot)
    task.seconds = seconds
    nominal = robot.space.from_dict(
        {"motor_noise": 0.0}
    )  # the bare batch has none, and contacts would differ
    trials = Trials(robot, task, Simulators(np.tile(nominal, (5, 1))), rate=robot.rate)
    genes = _standing(trials, gaits)
    actions = trials.space.targets(genes, trials.times)
    ways = [_stepped, _rolled]
    ratios, ours = [], []
    trials.grades(genes)
    for _ in range(rounds):
        before, began = trials.physics_steps, time.perf_counter()
        trials.grades(genes)
        ours.append((trials.physics_steps - before) / (time.perf_counter() - began))
        bare = max(way(robot, actions) for way in ways)
        ratios.append(ours[-1] / bare)
    steps = float(np.median(ours))
    return {
        "gaits": gaits,
        "steps_a_second": steps,
        "gaits_a_second": steps / (5 * len(trials.times) * SUBSTEPS),
        "share": float(np.median(ratios)),
    }


def _standing(trials: Trials, count: int) -> np.ndarray:
    """(count, G) small gaits that fall nowhere, so that both ways have the same to do."""
    rng, space, found = stream(0, "gait speed"), trials.space, []
    while len(found) < count:
        unit = rng.uniform(size=(50, len(space)))
        genes = space.from_unit(unit)
        genes[:, 1:4] *= 0.05
        genes[:, 4:7] = 0.12, 0.3, -0.6
        stood = (trials.walk(genes).fell > len(trials.times)).all(axis=0)
        found += list(genes[stood])
    return np.array(found[:count])


def _stepped(robot, actions: np.ndarray) -> float:
    """Steps/s of a loop that writes the commands and steps."""
    batch, commands = _batch(robot, actions)
    ctrl, qpos = batch.bind("ctrl"), batch.bind("qpos")
    trace = np.empty((commands.shape[1], *qpos.shape))
    began = time.perf_counter()
    for t in range(commands.shape[1]):
        ctrl[:] = commands[:, t]
        batch.step(nstep=SUBSTEPS)
        trace[t] = qpos
    return batch.nsim * commands.shape[1] * SUBSTEPS / (time.perf_counter() - began)


def _rolled(robot, actions: np.ndarray) -> float:
    """Steps/s of one call of `Batch.rollout`."""
    batch, commands = _batch(robot, actions)
    control = np.repeat(commands, SUBSTEPS, axis=1)
    began = time.perf_counter()
    batch.rollout(control.shape[1], control, record=("qpos",))
    return batch.nsim * control.shape[1] / (time.perf_counter() - began)


def _batch(robot, actions: np.ndarray) -> tuple[Batch, np.ndarray]:
    batch = Batch(robot.model, 5 * len(actions))
    batch.reset(keyframe=0)
    batch.step(nstep=75)
    return batch, np.tile(actions, (5, 1, 1))


if __name__ == "__main__":
    main()
