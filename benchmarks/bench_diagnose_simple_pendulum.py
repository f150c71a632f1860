"""The real pendulum whose logs do not tell its mass: what fits claim, what a diagnosis says, how often it is right.

Two logged runs of the same energy shaping, the second with about 0.4 kg more at the bob. Three usual estimators give
the difference with a narrow interval each. The diagnosis says from what it cannot tell the payload, an interval that
holds in either case, and the experiment. Its coverage is measured on simulated copies: the commands of the second
run; masses, frictions and all else drawn from the nameplate; payload drawn; a third have more dry friction besides, a
third an error of the drive's gain; another engine, a time step ten times finer, disturbance, noise, quantisation.
"""

import argparse
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from kept import RESULTS
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
from scipy.stats import norm

import dynreg
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.pose import pose
from dynreg.errors import LogError
from dynreg.evidence.hypothesis import Coordinates, Hypothesis
from dynreg.evidence.lockstep import run as answered
from dynreg.evidence.point import Point
from dynreg.evidence.truth import hide
from dynreg.results import Diagnosis
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.real import disturbance, finer
from dynreg.sim.robot import Robot, load_robot
from dynreg.sim.run import Run

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
RUNS = ("energy_shaping", "energy_shaping_1kg")
BATCH = 50  # copies simulated at once
HORIZON = 1.0  # s: upright, the pendulum forgets its start in a quarter of that
NINETY = 1.645
GRAVITY = 9.81
PAYLOAD = 0.40  # share of the bob, 1 sigma of the payloads that copies carry: the effect's strong size
FRICTION = 0.36  # N m, 1 sigma of the dry friction that a third of them have besides
GAIN = 0.40  # 1 sigma of the drive's error of another third
EFFECTS = ("payload", "coulomb_friction", "drive_gain")
BESIDES = ("", "coulomb_friction", "drive_gain")
BOB = 0.62  # kg, which shares of the payload are of
TRUE_DIFFERENCE = 0.4  # kg


@dataclass(frozen=True)
class Copy:
    """A simulated robot, the share of its payload, and which effect it has besides."""

    recording: Recording
    share: float
    besides: str


def diagnosed(registry, recording, seed: int = 0) -> Diagnosis:
    """Is it the payload, and how large is it?"""
    return registry.diagnose(
        recording,
        effects=["payload"],
        engine="joint",
        horizon=HORIZON,
        threshold_runs=0,
        threads=1,
        seed=seed,
    )


def interval(found: Diagnosis) -> dict[str, list[float]]:
    """Lowest and highest share of the payload: if nothing else is amiss, and whatever acts."""
    alone, wide = found.looked.alone["mass"], found.looked.whatever["mass"]
    return {"alone": [alone.low / BOB, alone.high / BOB], "reported": [wide.low / BOB, wide.high / BOB]}


def copies(robot: Robot, run: Run, seeds: range) -> list[Copy]:
    """Robots of the nameplate that get the commands of `run` (one episode), on another engine than the diagnosis."""
    drawn = [_drawn(robot, seed) for seed in seeds]
    truth, limits = finer(robot), Coordinates(robot, np.full(len(robot.space), np.nan)).drive_limits
    draws = np.stack([stream(seed, "copy disturbance").standard_normal((1, run.steps, 1)) for seed in seeds])
    terms = Terms(
        tuple(term(key) for key in EFFECTS),
        tuple(np.array([[d[key] * (BOB if key == "payload" else 1.0)] for d in drawn]) for key in EFFECTS),
    ) + disturbance(truth, limits).tiled(len(drawn))
    parameters = np.array([d["parameters"] for d in drawn])
    own = replace(run, draws=draws)
    states = rollout(truth, parameters, own, engine="mujoco", threads=1, terms=terms).states[:, 0]
    return [
        Copy(_logged(robot, run, _sensed(robot, s, seed)), d["payload"], d["besides"])
        for s, d, seed in zip(states, drawn, seeds, strict=True)
    ]


def _drawn(robot: Robot, seed: int) -> dict:
    """A robot's parameters (P,), the sizes of its effects (NaN where it has none), and which it has besides."""
    rng = stream(seed, "copy")
    sizes = {
        "payload": float(abs(rng.normal(0.0, PAYLOAD))),
        "coulomb_friction": float(abs(rng.normal(0.0, FRICTION))),
        "drive_gain": float(np.clip(rng.normal(0.0, GAIN), -0.8, 0.8)),
    }
    besides = BESIDES[int(rng.integers(len(BESIDES)))]
    kept = {k: v if k in ("payload", besides) else np.nan for k, v in sizes.items()}
    plate = hide(robot, (), None, stream_seed(seed, "copy nameplate") % 2**31)
    return kept | {"besides": besides, "parameters": plate.parameters}


def _sensed(robot: Robot, states: np.ndarray, seed: int) -> np.ndarray:
    """(T+1, S) what the sensors say of states: stated noise and quantum."""
    noise, quantum = (np.array([getattr(c, k) for c in robot.file.channels]) for k in ("noise", "quantum"))
    said = states + noise * stream(seed, "copy sensors").standard_normal(states.shape)
    return np.round(said / quantum) * quantum


def _logged(robot: Robot, run: Run, states: np.ndarray) -> Recording:
    actions = np.concatenate([run.actions[0], run.actions[0, -1:]])
    channels = [Channel(c.name, c.unit) for c in (*robot.file.channels, *robot.file.actions)]
    time_of = np.arange(len(states)) * run.period
    episode = Episode("copy", time_of, np.concatenate([states, actions], axis=1), {})
    return Recording(tuple(channels), (episode,), measured=False)


def commands(robot: Robot, recording: Recording) -> Run:
    """The commands of a recording's first episode, from rest."""
    values = recording.episodes[0].values[:, recording.columns(robot.actions)]
    return Run(
        values[None, :-1],
        inputs=np.tile(robot.input_defaults, (1, len(values) - 1, 1)),
        settings=np.zeros((1, 0)),
        initial=np.zeros((1, len(robot.channels))),
        period=1.0 / robot.rate,
        begin=np.zeros(1),
    )


def covered(rows: list[dict], key: str, besides: tuple[str, ...] = BESIDES) -> dict:
    """How often the interval `key` holds the truth, with its standard error, and its median width [kg]."""
    told = [r for r in rows if key in r and r["besides"] in besides]
    hits = np.array([r[key][0] <= r["share"] <= r[key][1] for r in told])
    width = np.array([r[key][1] - r[key][0] for r in told])
    if not told:
        return {"copies": 0}
    rate = float(hits.mean())
    error = float(np.sqrt(rate * (1 - rate) / len(hits)))
    return {
        "copies": len(told),
        "rate": rate,
        "error": error,
        "median_width_kg": BOB * float(np.median(width)),
    }


def measure(robot: Robot, run: Run, seeds: range) -> Iterator[dict]:
    """Diagnose copies; one row each, without an interval where the recording is refused: stuck, it says nothing."""
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as registry:
        for seed, copy in zip(seeds, copies(robot, run, seeds), strict=True):
            row = {"seed": seed, "share": copy.share, "besides": copy.besides}
            name = registry.ingest(copy.recording, robot, name=f"copy {seed}").recording
            try:
                found = diagnosed(registry, name)
            except LogError as refused:
                yield row | {"refused": str(refused)}
                continue
            row |= {"verdict": found.verdict, "pairs": [list(p.between) for p in found.inseparable]}
            yield row | interval(found) | {"seconds": found.cost.seconds}


def regressed(robot: Robot, recording: Recording) -> tuple[float, float]:
    """Mass and its standard error [kg] by least squares on torques, the usual identification; length as stated."""
    episode = recording.episodes[0]
    angle, speed, torque = (
        episode.values[:, recording.names.index(f"pivot/{key}")] for key in ("position", "velocity", "torque")
    )
    faster = savgol_filter(speed, 11, 2, deriv=1, delta=1.0 / robot.rate)
    smooth = savgol_filter(speed, 11, 2)
    nominal = {p.name: p.nominal for p in robot.file.parameters}
    length = nominal["length"]
    columns = [length**2 * faster + GRAVITY * length * np.sin(angle), smooth, np.sign(smooth)]
    matrix = np.stack(columns, axis=1)[np.abs(smooth) > 0.3]
    told = (torque - nominal["rotor_inertia"] * faster)[np.abs(smooth) > 0.3]
    found, *_ = np.linalg.lstsq(matrix, told, rcond=None)
    left = told - matrix @ found
    spread = np.linalg.inv(matrix.T @ matrix) * (left @ left) / (len(told) - 3)
    return float(found[0]), float(np.sqrt(spread[0, 0]))


def replayed(robot: Robot, recording: Recording, free: tuple[str, ...]) -> tuple[float, float]:
    """Mass and its standard error [kg] by robust least squares on rollouts; all but `free` as on the plate."""
    settings = DiagnosisOptions(engine="joint", horizon=HORIZON, threads=1)
    model, data = pose(robot, recording, settings)
    coordinates, every = model.coordinates, data.sample(np.arange(len(data.windows)))
    names = [robot.space.parameters[i].name for i in coordinates.free]
    at = [names.index(name) for name in free]

    def point(z: np.ndarray) -> Point:
        full = np.zeros(len(names))
        full[at] = z
        return Point(Hypothesis(), np.clip(full, *coordinates.nominal_bounds.T), np.zeros(0))

    def residual(z: np.ndarray) -> np.ndarray:
        return np.nan_to_num(answered(model.residuals([point(z)], every), threads=1)[0]).reshape(-1)

    limits = coordinates.nominal_bounds[at].T * 0.999
    starts = [
        least_squares(
            residual, np.clip(np.full(len(at), s), *limits), bounds=limits, diff_step=0.05, loss="soft_l1"
        )
        for s in (0.0, 1.0, 3.0)
    ]
    best = min(starts, key=lambda s: s.cost)
    spread = np.linalg.pinv(best.jac.T @ best.jac) * 2 * best.cost / (len(best.fun) - len(at))
    mass = coordinates.values(point(best.x).nominal)[robot.space.names.index("mass")]
    sigma = coordinates.sigma[robot.space.names.index("mass")]
    return float(mass), float(mass * sigma * np.sqrt(spread[0, 0]))


PEERS = {
    "torque regression": regressed,
    "rollouts, mass alone": lambda *a: replayed(*a, ("mass",)),
    "rollouts, mass and friction": lambda *a: replayed(*a, ("mass", "coulomb", "viscous")),
}


def real(robot: Robot, recordings: dict[str, Recording], registry) -> dict:
    """What every estimator says of the two runs' difference, and what the diagnosis says."""
    out: dict = {"peers": {}, "diagnoses": {}}
    for title, estimator in PEERS.items():
        found = [estimator(robot, recordings[name]) for name in RUNS]
        apart, error = found[1][0] - found[0][0], float(np.hypot(found[0][1], found[1][1]))
        ends = [apart - NINETY * error, apart + NINETY * error]
        out["peers"][title] = {
            "masses_kg": [f[0] for f in found],
            "difference_kg": apart,
            "interval_kg": ends,
            "holds": ends[0] <= TRUE_DIFFERENCE <= ends[1],
        }
        print(
            f"{title}: {found[0][0]:.3f} and {found[1][0]:.3f} kg, difference {apart:.3f}"
            f" [{ends[0]:.3f}, {ends[1]:.3f}] kg"
        )
    for name in RUNS:
        found = diagnosed(registry, name)
        kg = [BOB * end for end in interval(found)["reported"]]
        true = TRUE_DIFFERENCE if name.endswith("1kg") else 0.0
        out["diagnoses"][name] = {
            "sentence": found.sentence,
            "pairs": [list(p.between) for p in found.inseparable],
            "interval_kg": kg,
            "alone_kg": [BOB * end for end in interval(found)["alone"]],
            "experiments": [p.experiment for p in found.inseparable],
            "holds": kg[0] <= true <= kg[1],
            "seconds": found.cost.seconds,
        }
        print(
            f"{found.sentence}\n  payload {kg[0]:.2f} to {kg[1]:.2f} kg; about {true:g} kg is true",
            flush=True,
        )
    return out


def summary(rows: list[dict]) -> dict:
    """Coverage and widths over copies, of all and by what they have besides."""
    prior = BOB * PAYLOAD * float(np.diff(norm.ppf([0.525, 0.975]))[0])
    out = {
        "prior_width_kg": prior,
        "seconds": float(np.median([r["seconds"] for r in rows if "seconds" in r])),
    }
    out["refused"] = sum("refused" in r for r in rows)
    for key in ("reported", "alone"):
        out[key] = {"all": covered(rows, key)} | {b or "nothing": covered(rows, key, (b,)) for b in BESIDES}
        for title, of in out[key].items():
            if not of["copies"]:
                continue
            print(
                f"{key}, besides: {title}: {100 * of['rate']:.1f} +- {100 * of['error']:.1f} % of {of['copies']}"
                f" covered, median width {of['median_width_kg']:.3f} kg (prior {prior:.3f})"
            )
    return out


def main() -> None:
    """Print the tables and write benchmarks/results/diagnose_simple_pendulum.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--copies", type=int, default=250)
    parser.add_argument("--first-seed", type=int, default=7000)
    parser.add_argument("--skip-real", action="store_true", help="copies alone, nothing written but rows")
    parser.add_argument("--rows", type=Path, help="file of the copies that are done: a second start goes on")
    given = parser.parse_args()
    folder = DATA / "dfki_simple_pendulum"
    if not folder.is_dir():
        print("bench_diagnose_simple_pendulum: skipped, no dfki_simple_pendulum in DYNREG_DATA_DIR")
        return
    robot = load_robot("simple_pendulum")
    with tempfile.TemporaryDirectory() as place, dynreg.open(place) as registry:
        recordings = {}
        for name in RUNS:
            logs = [folder / f"control_method_{name}_{part}.csv" for part in ("measured", "desired")]
            recordings[name] = registry.registry.recording(registry.ingest(logs, robot, name=name).recording)
        out = {} if given.skip_real else real(robot, recordings, registry)
    rows = json.loads(given.rows.read_text()) if given.rows and given.rows.exists() else []
    if rows and rows[0]["seed"] != given.first_seed:
        raise SystemExit(
            f"{given.rows} begins with seed {rows[0]['seed']}: name another file, or --first-seed"
        )
    first = given.first_seed + len(rows)
    for seed in range(first, given.first_seed + given.copies, BATCH):
        batch = range(seed, min(seed + BATCH, given.first_seed + given.copies))
        for row in measure(robot, commands(robot, recordings[RUNS[1]]), batch):
            rows.append(row)
            if given.rows:
                given.rows.write_text(json.dumps(rows))
    if rows:
        out["copies"] = summary(rows)
    if given.skip_real:
        return
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "diagnose_simple_pendulum.json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
