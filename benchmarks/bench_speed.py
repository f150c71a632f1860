"""Speed on this machine: populate, physics as a share of a bare MuJoCo batch loop, query, peak memory."""

import argparse
import json
import os
import resource
import shutil
import time
from pathlib import Path

import numpy as np
from bare_physics import SEED, physics
from hidden import hidden_robots
from kept import RESULTS

import dynreg
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot

HERE = Path(__file__).parent


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
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "speed.json").write_text(json.dumps(out, indent=1) + "\n")
    shutil.rmtree(given.registry, ignore_errors=True)


if __name__ == "__main__":
    main()
