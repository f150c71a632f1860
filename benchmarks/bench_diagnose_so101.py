"""Diagnosis of the real SO-101 arm, joint by joint: causes, lag, and the error on four held-out motions.

Against a plain servo for each joint (stiffness, damping, inertia, torque limit, gravity load, constant load and
delay) that CMA-ES fitted to the same windows of the same motions. Closed-loop rollouts from commands alone: of 5 s
from measured states, each joint alone; and of whole motions from their start, each joint alone and all together in
MuJoCo, whose dry friction the model makes firm: it would creep where a joint stands under load.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from kept import RESULTS

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.diagnose.account import Account, with_account
from dynreg.diagnose.diagnose import Diagnosed, diagnose
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run as answered
from dynreg.evidence.lockstep import together
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.results.result import Cost
from dynreg.rng import stream
from dynreg.search.cmaes import CmaEs
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run
from dynreg.verbs.diagnosis import document
from dynreg.verbs.simulator import NOMINAL
from dynreg.verbs.subjects import Recorded, robot_of

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
FILE = RESULTS / "diagnose_so101.json"
JOINTS = ("rotation", "pitch", "elbow", "wrist_pitch", "wrist_roll", "jaw")
HELD_OUT = ("chirp_sweep", "prbs_excitation", "hold_under_gravity", "large_amplitude")
SHARED = ("upper_length", "lower_length", "upper_mass", "lower_mass", "hand_mass")
MODELS = ("plain", "calibrated", "extended")
WINDOWS = 11  # to fit, and as many to select by
PACES = {
    "slow": (0.02, 0.5),
    "moderate": (0.5, 2.0),
    "fast": (2.0, 20.0),
}  # rad/s, commanded, but for the fastest 1 %
LONGEST_LAG, WHOLE = 0.4, 200.0  # s
DELAYS = (0.0, 0.2)  # s, of the plain servo


def plain(model: Model, data: Data, joint: str, budget: int, seed: int = 0) -> Point:
    """The plain servo with delay whose mean absolute error on the windows to fit and select by is least."""
    hypothesis = Hypothesis((term(f"force_offset[{joint}]"), term(f"command_delay[{joint}]")))
    coordinates, sample = model.coordinates, data.sample(data.parts.chosen)
    scale = coordinates.scale(hypothesis.terms[1], hypothesis.parameters[1])
    load = coordinates.scales["torque"][0] * 0.5
    load /= coordinates.scale(hypothesis.terms[0], hypothesis.parameters[0])
    limits = np.concatenate([coordinates.nominal_bounds, [(-load, load), (DELAYS[0], DELAYS[1] / scale)]])
    many = len(coordinates)
    start = np.concatenate([np.zeros(many), [0.0, 0.03 / scale]])
    search = CmaEs((start - limits[:, 0]) / np.ptp(limits, axis=1), sigma=0.2, rng=stream(seed, "refit"))
    spent = 0
    while spent < budget and not search.stopped:
        z = limits[:, 0] + search.ask() * np.ptp(limits, axis=1)
        points = [Point(hypothesis, row[:many], row[many:]) for row in z]
        left = answered(model.residuals(points, sample), threads=1)
        search.tell(np.nanmean(np.abs(left), axis=(1, 2, 3)))
        spent += len(z)
    z = limits[:, 0] + search.best * np.ptp(limits, axis=1)
    return Point(hypothesis, z[:many], z[many:])


def config_of(robot: Robot, values: np.ndarray, terms: Terms | None) -> SimConfig:
    """A simulator, of parameters (P,) and effects of one row, as its configuration."""
    effects = {}
    for one, row in zip(terms.terms, terms.values, strict=True) if terms else ():
        names = [p.name for p in one.effect.parameters]
        effects[one.key] = dict(zip(names, map(float, row[0]), strict=True))
    return SimConfig(robot.hash, robot.name, robot.space.as_dict(values), effects)


def motion_errors(robot: Robot, data: Data, states: np.ndarray, joint: str, recording: Recording) -> dict:
    """{motion: mean absolute error of the joint's position [rad]} of states (W, T+1, S) in the test windows."""
    column = robot.channels.index(f"{joint}/position")
    test = np.flatnonzero(data.parts.test)
    miss = np.abs(states[:, 1:, column] - data.windows.measured[test][:, 1:, column])
    owner = [recording.episodes[e].name for e in data.windows.episode[test]]
    return {m: float(np.nanmean(miss[[o == m for o in owner]])) for m in HELD_OUT}


def short_errors(
    robot: Robot, data: Data, configs: dict[str, SimConfig], joint: str, recording: Recording
) -> dict:
    """{model: {motion: error}} of windows from measured states, the joint alone."""
    run, out = data.windows.run.take(np.flatnonzero(data.parts.test)), {}
    for name, config in configs.items():
        values = robot.space.from_dict(dict(config.values))[None]
        states = rollout(robot, values, run, engine="joint", threads=1, terms=_terms(robot, config)).states
        out[name] = motion_errors(robot, data, states[0], joint, recording)
    return out


def whole_states(robot: Robot, run: Run, rows: dict, model: str, engine: str) -> np.ndarray:
    """(6, W, T+1, S) rollouts of whole motions from their start, by joint.

    Lengths and masses were fitted by each joint to itself: each joint is read off an arm that has its own.
    """
    configs = {j: _config(robot, rows[j]["simulators"][model]) for j in JOINTS}
    merged = {
        name: value
        for j in JOINTS
        for name, value in configs[j].values.items()
        if name.startswith(f"{j}_") and name not in SHARED
    }
    values = [robot.space.from_dict(merged | {n: configs[j].values[n] for n in SHARED}) for j in JOINTS]
    effects = {key: value for j in JOINTS for key, value in configs[j].effects.items()}
    terms = _terms(robot, SimConfig(robot.hash, robot.name, merged, effects), len(JOINTS))
    return rollout(robot, np.array(values), run, engine=engine, threads=1, terms=terms).states


def whole_errors(robot: Robot, recording: Recording, rows: dict, engine: str) -> dict:
    """{joint: {model: {motion: error}}} of whole held-out motions from their start."""
    settings = DiagnosisOptions(hold_out=",".join(HELD_OUT), horizon=WHOLE)
    _, data = pose(robot, recording, settings)
    run = data.windows.run.take(np.flatnonzero(data.parts.test))
    out: dict = {joint: {} for joint in JOINTS}
    for model in MODELS:
        states = whole_states(robot, run, rows, model, engine)
        for i, joint in enumerate(JOINTS):
            out[joint][model] = motion_errors(robot, data, states[i], joint, recording)
    return out


def lags(recording: Recording, joint: str) -> dict[str, dict[str, float]]:
    """{pace: {motion: s}} by which the position follows the command.

    The shift at which a straight line through (command, position) leaves least.
    """
    out: dict = {pace: {} for pace in PACES}
    command, position = recording.columns((f"{joint}/target", f"{joint}/position"))
    for episode in recording.episodes:
        t, u, q = episode.time, episode.values[:, command], episode.values[:, position]
        fastest = np.quantile(np.abs(np.gradient(u, t)), 0.99)
        pace = next((p for p, (low, high) in PACES.items() if low <= fastest < high), None)
        if pace is None:
            continue
        shifts = np.arange(0.0, LONGEST_LAG, 0.005)
        later = t > t[0] + LONGEST_LAG
        alike = [np.corrcoef(np.interp(t[later] - s, t, u), q[later])[0, 1] for s in shifts]
        out[pace][episode.name] = float(shifts[int(np.argmax(alike))])
    return out


def simulated(robot: Robot, recording: Recording, rows: dict, model: str) -> dict[str, Recording]:
    """{joint: the recording as a simulator of that joint has it}, whole motions from their start."""
    cut = pose(robot, recording, DiagnosisOptions(horizon=WHOLE))[1].windows
    states, out = whole_states(robot, cut.run, rows, model, "joint"), {}
    for number, joint in enumerate(JOINTS):
        logged = recording.columns((f"{joint}/position",))[0]
        column, episodes = robot.channels.index(f"{joint}/position"), []
        for window, (first, end) in enumerate(cut.rows):
            episode = recording.episodes[cut.episode[window]]
            values = np.array(episode.values[first:end])
            values[:, logged] = states[number, window, : end - first, column]
            episodes.append(Episode(episode.name, episode.time[first:end], values, episode.settings))
        out[joint] = Recording(recording.channels, tuple(episodes), measured=False)
    return out


def parts_of_lag(simulator: dict, joint: str) -> dict[str, float]:
    """{part: s} of a simulator's lag where nothing rubs: delay, first-order lag, damping over stiffness."""
    values, effects = simulator["values"], simulator["effects"]
    damping = values[f"{joint}_torque"] / values[f"{joint}_speed"]
    return {
        "command_delay": effects.get(f"command_delay[{joint}]", {}).get("delay", 0.0),
        "command_lag": effects.get(f"command_lag[{joint}]", {}).get("time", 0.0),
        "servo": damping / values[f"{joint}_gain"],
    }


def _config(robot: Robot, given: dict) -> SimConfig:
    return SimConfig(robot.hash, robot.name, given["values"], given["effects"])


def _terms(robot: Robot, config: SimConfig, times: int = 1) -> Terms | None:
    made = terms_of(config, robot)
    return made.tiled(times) if made.terms else None


def _plain_dict(config: SimConfig) -> dict:
    return {"values": dict(config.values), "effects": {k: dict(v) for k, v in config.effects.items()}}


def one_joint(
    asked: Recorded, options: DiagnosisOptions, made: Diagnosed, seen: Account, budget: int, spent: float
) -> dict:
    """The row of one joint: its diagnosis, the plain servo's errors and its own on the held-out motions, lags.

    spent : [s] of its diagnosis.
    """
    (joint,), robot, loaded = options.joints, asked.robot, asked.recording
    cost = Cost(evaluations=0, rollouts=0, test_rollouts=len(made.judged.states), seconds=spent)
    found = document(asked, NOMINAL, options, made, seen, dict.fromkeys(seen.simulators), cost)
    model, data = made.problem.model, made.problem.data
    began = time.perf_counter()
    point = plain(model, data, joint, budget)
    seconds = time.perf_counter() - began
    sizes = model.coordinates.effect_values(point.hypothesis, point.effect[None])
    simulators = {
        "plain": (model.coordinates.values(point.nominal), Terms(point.hypothesis.terms, tuple(sizes))),
        "extended": seen.simulators["calibrated"],
        **seen.simulators,
    }
    configs = {name: config_of(robot, *simulators[name]) for name in MODELS}
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "causes": [
            {
                "key": c.key,
                "nats": c.evidence_nats,
                "values": {n: e.value for n, e in c.parameters.items()},
                "equivalent": list(c.equivalent),
                "at_bound": any(e.at_bound for e in c.parameters.values()),
            }
            for c in found.causes
        ],
        "parts of lag": {name: parts_of_lag(_plain_dict(config), joint) for name, config in configs.items()},
        "simulators": {name: _plain_dict(config) for name, config in configs.items()},
        "errors": short_errors(robot, data, configs, joint, loaded),
        "seconds": {"diagnosis": found.cost.seconds, "plain": seconds},
    }


def rows_of(asked: Recorded, given: argparse.Namespace) -> Iterator[tuple[str, dict]]:
    """(joint, row) of every joint that was asked for; all are diagnosed in lockstep, and share the time it takes."""
    how = {"hold_out": ",".join(HELD_OUT), "windows": given.windows, "threads": 1}
    how |= {"max_causes": given.max_causes, "threshold_runs": 0}
    options = [DiagnosisOptions(joints=(joint,), **how) for joint in given.joints]
    began = time.perf_counter()
    searches = [with_account(diagnose(asked.robot, asked.recording, one), one) for one in options]
    found = answered(together(searches), threads=1)
    spent = (time.perf_counter() - began) / len(options)
    for joint, one, (made, seen) in zip(given.joints, options, found, strict=True):
        yield joint, one_joint(asked, one, made, seen, given.budget, spent)


def tell(joint: str, row: dict) -> None:
    """Print one joint's diagnosis."""
    said = [f"{c['key']} ({c['nats']:.0f} nats)" for c in row["causes"]]
    print(
        f"{joint}: {row['verdict']}, {', '.join(said) or 'no cause'}\n"
        f"  diagnosis {row['seconds']['diagnosis']:.0f} s, plain servo {row['seconds']['plain']:.0f} s",
        flush=True,
    )


def table(title: str, errors: dict) -> None:
    """Print mean absolute errors [rad] by joint and by motion, and how much less the extended simulators leave."""
    print(f"{title}\n  {'':20}" + "".join(f"{m:>12}" for m in MODELS) + "   extended against plain")
    by = {j: {m: np.mean(list(errors[j][m].values())) for m in MODELS} for j in errors}
    by |= {k: {m: np.mean([errors[j][m][k] for j in errors]) for m in MODELS} for k in HELD_OUT}
    by["all"] = {m: np.mean([by[j][m] for j in errors]) for m in MODELS}
    for name, row in by.items():
        print(
            f"  {name:20}"
            + "".join(f"{row[m]:12.5f}" for m in MODELS)
            + f"{row['extended'] / row['plain'] - 1:+12.0%}"
        )


def lag_table(rows: dict, seen: dict) -> None:
    """Print the lag of each joint by pace, in the log and in simulators, and the parts of it that these have."""
    print("lag [ms]: median (least to most, motions); delay + lag + damping / stiffness of the simulators")
    for joint in rows:
        for source in ("measured", "plain", "extended"):
            told = []
            for pace, motions in seen.get(source, {}).get(joint, {}).items():
                ms = 1000 * np.array(list(motions.values()))
                if len(ms):
                    told.append(f"{pace} {np.median(ms):.0f} ({ms.min():.0f} to {ms.max():.0f}, {len(ms)})")
            if source != "measured":
                parts = parts_of_lag(rows[joint]["simulators"][source], joint)
                told.append(" + ".join(f"{1000 * s:.0f}" for s in parts.values()))
            print(f"  {joint:12}{source:10}" + "; ".join(told))


def main() -> None:
    """Print the tables and write benchmarks/results/diagnose_so101.json; joints left out keep their rows there."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--joints", nargs="*", default=list(JOINTS), choices=JOINTS)
    parser.add_argument("--windows", type=int, default=WINDOWS)
    parser.add_argument("--max-causes", type=int, default=4)
    parser.add_argument("--budget", type=int, default=1000, help="simulations of CMA-ES for each joint")
    parser.add_argument(
        "--no-whole", action="store_true", help="leave out whole motions: their errors, simulated lags"
    )
    given = parser.parse_args()
    logs = sorted((DATA / "sage_so101_arm").glob("*.parquet"))
    if not logs:
        print("bench_diagnose_so101: skipped, no SO-101 log in DYNREG_DATA_DIR")
        return
    rows = json.loads(FILE.read_text())["joints"] if FILE.exists() else {}
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        recording = reg.ingest(logs, "so101", name="arm").recording
        robot = robot_of(reg.registry, recording)
        loaded = reg.registry.recording(recording)
        for joint, row in rows_of(Recorded(reg.registry, robot, loaded, "arm"), given):
            rows[joint] = row
            tell(joint, row)
            FILE.parent.mkdir(exist_ok=True)
            FILE.write_text(json.dumps({"joints": rows}, indent=1) + "\n")
        rows = {j: rows[j] for j in JOINTS if j in rows}
        table("5 s from measured states, each joint alone [rad]", {j: rows[j]["errors"] for j in rows})
        seen = {"measured": {j: lags(loaded, j) for j in rows}}
        if len(rows) == len(JOINTS) and not given.no_whole:
            for model in ("plain", "extended"):
                made = simulated(robot, loaded, rows, model)
                seen[model] = {j: lags(made[j], j) for j in rows}
        lag_table(rows, seen)
        document: dict = {"joints": rows, "lag": seen}
        if len(rows) == len(JOINTS) and not given.no_whole:
            document["whole"] = {}
            for engine in ("joint", "mujoco"):
                errors = whole_errors(robot, loaded, rows, engine)
                document["whole"][engine] = errors
                table(f"whole motions from their start, engine {engine} [rad]", errors)
        FILE.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
