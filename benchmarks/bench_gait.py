"""How well gaits walk: searches compared on the nominal quadruped, and gaits for hidden robots tried on them.

1. Hill climber, CMA-ES and random search on the nominal quadruped ("nominal"), and in five simulators a quarter of
   the way from it to draws of the population ("five"): fitness against gaits tried, and seconds.
2. Hidden quadrupeds, each with an effect that no simulator has ("hidden"): gaits sought in the five simulators, in the
   nominal one and in one with the true parameters are tried once on the robot.

Parts that were not asked for keep the figures that they had.
"""

import argparse
import json
import time

import numpy as np
from kept import RESULTS

from dynreg.evidence.truth import hide
from dynreg.gait.seek import SearchSettings, Sought, seek
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.rng import stream_seed
from dynreg.sim.effects import term
from dynreg.sim.real import Budget, SimulatedRobot
from dynreg.sim.robot import load_robot

SEED = 61
RATE = 36.0
HIDDEN = ("coulomb_friction", "payload", "command_delay", "backlash")


def main() -> None:
    """Measure, print, and keep the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--gaits", type=int, default=1500, help="of the hill climber; the others have a third"
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--parts", default="nominal,five,hidden")
    given = parser.parse_args()
    kept = RESULTS / "gait.json"
    figures = json.loads(kept.read_text()) if kept.is_file() else {}
    for part in given.parts.split(","):
        if part == "hidden":
            figures[part] = [_hidden(i, given.gaits // 3) for i in range(len(HIDDEN))]
        else:
            figures[part] = _searches(part, given.gaits, given.seeds)
    kept.write_text(json.dumps(figures, indent=1) + "\n")


def _searches(part: str, gaits: int, seeds: int) -> list[dict]:
    robot = load_robot("quadruped")
    simulators = Simulators(robot.space.nominal[None] if part == "nominal" else _near(robot, 5))
    out = []
    for seed in range(seeds):
        for method, count in (("hill", gaits), ("cma", gaits // 3), ("random", gaits // 3)):
            trials = Trials(robot, task_of(robot), simulators, rate=RATE, seed=SEED)
            began = time.perf_counter()
            found = _seek(trials, method, count, seed)
            row = {
                "method": method,
                "seed": seed,
                "gaits": found.found.evaluations,
                "fitness": found.fitness.tolist(),
                "history": found.found.history,
                "seconds": time.perf_counter() - began,
                "steps": trials.physics_steps,
            }
            out.append(row)
            least, spent = min(row["fitness"]), row["seconds"]
            print(
                f"{part}: {method}, seed {seed}: {least:.2f} m at worst after {row['gaits']} gaits, {spent:.0f} s"
            )
    return out


def _hidden(number: int, gaits: int) -> dict:
    robot = load_robot("quadruped")
    task = task_of(robot)
    truth = hide(robot, (term(HIDDEN[number]),), "medium", stream_seed(SEED, "hidden", number) % 2**31)
    real = SimulatedRobot(
        robot, truth.parameters, truth.terms, truth.values, seed=truth.seed, budget=Budget(trials=3)
    )
    sources = {"true parameters": truth.parameters[None], "five about nominal": _near(robot, 5)}
    sources["nominal"] = robot.space.nominal[None]
    row = {"effect": HIDDEN[number]}
    for name, values in sources.items():
        trials = Trials(robot, task, Simulators(values), rate=RATE, seed=SEED)
        found = _seek(trials, "cma", gaits, number)
        trial = real.run(trials.space.targets(found.genes[None], trials.times)[0], RATE)
        there = float(fitness(task.grade(trial.walk))[0, 0])
        row[name] = {"simulated": found.found.value, "real": there, "fell": trial.fell}
        print(
            f"hidden {HIDDEN[number]}: {name}: {found.found.value:.2f} m in simulation, {there:.2f} m on the robot"
        )
    return row


def _near(robot, count: int) -> np.ndarray:
    """(count, P) the nominal simulator, and others a quarter of the way from it to draws of the population."""
    draws = robot.space.sample(0, count, stream_seed(SEED, "near") % 2**31)
    values = 0.75 * robot.space.nominal + 0.25 * draws
    values[0] = robot.space.nominal
    values[:, robot.space.names.index("action_rate")] = RATE
    return values


def _seek(trials: Trials, method: str, gaits: int, seed: int) -> Sought:
    return seek(trials, SearchSettings(method, rollouts=gaits * len(trials.simulators), seed=seed))


if __name__ == "__main__":
    main()
