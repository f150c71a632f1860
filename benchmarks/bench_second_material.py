"""Paper E's second material: is it found on hidden AIBOs, and by how much does the error of backward walks fall?

Robots with elbows more slippery than their paws, and robots without, in turn. All 38 parameters of each differ from the
nameplate by its tolerances, and all are free in the diagnosis, which begins at the nominal simulator. It is asked for
causes on the ground and in the body. Backward walks that it does not see are replayed in the simulator that was only
calibrated, and in that with the causes. A journal keeps each robot: a second start goes on.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import aibo
import numpy as np
from journal import Journal
from kept import RESULTS
from naming import TUNE
from scipy.stats import binomtest

import dynreg
from dynreg.data.recording import Recording
from dynreg.methods.losses import mean_velocities
from dynreg.replay.data import data
from dynreg.results import Diagnosis
from dynreg.rng import stream_seed
from dynreg.session import Session
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot, load_robot

REPORT = 20270118
FILE = RESULTS / "second_material.json"
MATERIAL = "second_friction_material"
EFFECTS = (MATERIAL, "ground_friction", "contact_compliance", "payload", "com_offset", "gravity_tilt")
SEEN, BACKWARD = 12, 4  # walks
HORIZON = 2.0  # s of each walk that the diagnosis replays: what comes after the first slips is chance
SKIP = 1.0  # s of a walk, as in the paper


def log_of(hidden: aibo.Hidden, robot: Robot) -> Recording:
    """Walks of all kinds to diagnose (A), and backward ones that are held out (B)."""
    seen = aibo.walks(robot, SEEN, hidden.seed)
    back = aibo.walks(robot, BACKWARD, hidden.seed + 1_000_000, back=1.0)
    named = {f"A{i}": w for i, w in enumerate(seen)} | {f"B{i}": w for i, w in enumerate(back)}
    return aibo.logged(hidden, robot, named, threads=1)


def row(session: Session, robot: Robot, number: int, seed: int) -> dict:
    """What a diagnosis says of one robot, what it takes, and what its simulators err by in backward walks."""
    hidden = aibo.hidden(stream_seed(seed, "second material", number) % 2**31, material=number % 2 == 0)
    log, name = log_of(hidden, robot), f"walks of {number}"
    session.ingest(log, robot, name=name)
    held = ",".join(e.name for e in log.episodes if e.name.startswith("B"))
    began = time.perf_counter()
    found = session.diagnose(
        name, effects=EFFECTS, hold_out=held, horizon=HORIZON, threshold_runs=0, max_causes=1, threads=1
    )
    out = {
        "robot": number,
        "seed": hidden.seed,
        "material": hidden.material,
        "causes": [{"effect": c.effect, "bodies": c.bodies, "nats": c.evidence_nats} for c in found.causes],
        "size": next((c.parameters["loss"].value for c in found.causes if c.effect == MATERIAL), None),
        "verdict": found.verdict,
        "seconds": time.perf_counter() - began,
        "simulators": found.cost.rollouts,
    }
    return out | {"errors": backward(session, robot, log, found)}


def backward(session: Session, robot: Robot, log: Recording, found: Diagnosis) -> dict[str, dict[str, float]]:
    """{simulator: {"speed", "replay"}} of the held-out walks.

    speed : [m/s] root mean square error of mean velocities, ahead and to the left, from the second second on. replay :
    mean absolute error of all channels in units of their spread.
    """
    cut = data(robot, log, ",".join(e.name for e in log.episodes if e.name.startswith("B")))
    test, rows, out = np.flatnonzero(cut.parts.test), round(SKIP / cut.windows.period), {}
    measured, velocities = cut.windows.measured[test], mean_velocities(cut)
    run = replace(cut.windows.run.take(test), initial=np.full_like(measured[:, 0], np.nan))
    simulators = {"nominal": None, "calibrated": found.calibrated_simulator}
    if found.extended_simulator is not None:
        simulators["extended"] = found.extended_simulator
    for kind, identity in simulators.items():
        values, terms = robot.space.nominal, None
        if identity is not None:
            config = SimConfig.from_dict(session.registry.simulator(identity))
            values = robot.space.from_dict(dict(config.values))
            terms = terms_of(config, robot) if config.effects else None
        states = rollout(robot, values[None], run, terms=terms, threads=1).states[0]
        states = np.where(np.isfinite(measured), states, np.nan)
        apart = velocities(states[:, rows:]) - velocities(measured[:, rows:])
        use = cut.windows.weight > 0
        off = np.abs(states - measured)[..., use] / cut.windows.spread[use]
        out[kind] = {
            "speed": float(np.sqrt(np.nanmean(np.sum(apart[:, :2] ** 2, axis=1)))),
            "replay": float(np.nanmean(off)),
        }
    return out


def told(rows: list[dict]) -> dict:
    """Print and return the table: how often the material is named, and what it does to the errors."""
    table: dict = {}
    for material in (True, False):
        own = [r for r in rows if r["material"] == material]
        named = sum(any(c["effect"] == MATERIAL for c in r["causes"]) for r in own)
        caused = sum(bool(r["causes"]) for r in own)
        kind = "with" if material else "without"
        table[kind] = {"robots": len(own), "material": named, "any cause": caused}
        if own:
            low, high = binomtest(named, len(own)).proportion_ci(0.95)
            print(
                f"{kind:8s} the material named in {named} of {len(own)} [{low:.2f}, {high:.2f}], a cause in {caused}"
            )
    with_it = [r for r in rows if r["material"]]
    for of in ("speed", "replay"):
        before = np.array([r["errors"]["calibrated"][of] for r in with_it])
        after = np.array([r["errors"].get("extended", r["errors"]["calibrated"])[of] for r in with_it])
        if len(before):
            fall = 1.0 - after / before
            table[of] = {
                "calibrated": float(before.mean()),
                "extended": float(after.mean()),
                "fall": float(1.0 - after.mean() / before.mean()),
                "median fall": float(np.median(fall)),
            }
            told_of = f"{before.mean():.4f} -> {after.mean():.4f}: {table[of]['fall']:.0%}"
            print(f"{of:8s} {told_of}, median {np.median(fall):.0%}")
    table["seconds"] = float(np.median([r["seconds"] for r in rows]))
    table["simulators"] = float(np.median([r["simulators"] for r in rows]))
    print(f"a diagnosis: {table['seconds']:.0f} s, {table['simulators']:.0f} simulators")
    return table


def main() -> None:
    """Print the table; that of all robots of the reporting seed is kept. `--tune` uses robots of development."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20, help="half of them with the material")
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--journal", type=Path)
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    path = given.journal or RESULTS / f"second_material{'_tune_' if given.tune else ''}.jsonl"
    journal = Journal(path, {"table": "second material", "seed": seed, "version": 2})
    journal.begin()
    robot, done = load_robot("aibo"), {line["robot"] for line in journal.lines()}
    for number in sorted({*range(given.robots)} - done):
        with TemporaryDirectory() as folder, dynreg.open(Path(folder) / "registry") as session:
            made = journal.add(row(session, robot, number, seed))
        print(
            json.dumps({k: made[k] for k in ("robot", "material", "causes", "errors", "seconds")}), flush=True
        )
    rows = [line for line in journal.lines() if line["robot"] < given.robots]
    table = told(rows)
    if not given.tune and given.robots == parser.get_default("robots"):
        FILE.write_text(json.dumps({"table": table, "robots": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
