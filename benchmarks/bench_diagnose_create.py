"""Diagnosis of a real iRobot Create from the kinematic model: told speeds in, poses out, the second half held out.

Open-loop rollouts of 10 s from measured poses every 5 s: root mean square distance over a rollout, and at its end [m],
and the yaw's root mean square error [rad]; with 90 % intervals over pieces of a minute (bootstrap). As commanded (no
lag, no gains), calibrated (speed and yaw gain fitted), diagnosed and extended.

Beside, what simple means see in log and simulators: the length of the driven path over that of the commanded one, the
slope of the yaw rate on its command, and by how much it comes later (means over half a second).
"""

import argparse
import json
import os
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from kept import RESULTS
from open_loop import Segments, simulated

import dynreg
from dynreg.data.recording import Episode, Recording
from dynreg.rng import stream
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot

HERE = Path(__file__).parent
DATA = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parent.parent / "shared" / "data"))
FILE = RESULTS / "diagnose_create.json"
ROLLOUT, EVERY, PIECE = 10.0, 5.0, 60.0  # s
HALVES = ("first half", "second half")
MEAN = 0.5  # s
LAGS = np.arange(0.0, 0.61, 0.02)  # s
DRAWS = 4000


@dataclass(frozen=True)
class Score:
    """distance, end [m] and yaw [rad] of one simulator, root mean squares, each with its interval."""

    distance: tuple[float, float, float]
    end: tuple[float, float, float]
    yaw: tuple[float, float, float]


def halves(recording: Recording) -> Recording:
    """The log as two episodes, one after the other: a part to test that is drawn from all of it would be easier."""
    whole = recording.episodes[0]
    cut = len(whole.time) // 2
    parts = [
        Episode(n, whole.time[s], whole.values[s])
        for n, s in zip(HALVES, (slice(cut), slice(cut, None)), strict=True)
    ]
    return Recording(recording.channels, tuple(parts), recording.measured, recording.provenance)


def squares(states: np.ndarray, segments: Segments) -> np.ndarray:
    """(W, 3) mean squared distance and at the end [m^2], mean squared error of the yaw [rad^2]."""
    apart = (states - segments.measured)[:, 1:]
    distance = (apart[..., :2] ** 2).sum(axis=2)
    return np.stack(
        [np.nanmean(distance, axis=1), distance[:, -1], np.nanmean(apart[..., 2] ** 2, axis=1)], 1
    )


def drawn(windows: int) -> np.ndarray:
    """(draws, W) windows of pieces of a minute, drawn with replacement: what follows each other is alike.

    Pieces run round, so that every window is drawn as often (Politis and Romano's circular bootstrap, 1992).
    """
    length = round(PIECE / EVERY)
    starts = stream(0, "pieces").integers(0, windows, (DRAWS, -(-windows // length)))
    return (starts[:, :, None] + np.arange(length)).reshape(DRAWS, -1)[:, :windows] % windows


def score(found: np.ndarray, draws: np.ndarray) -> Score:
    """Of mean squares (W, 3)."""
    out = []
    for column in found.T:
        low, high = np.sqrt(np.nanquantile(np.nanmean(column[draws], axis=1), [0.05, 0.95]))
        out.append((float(np.sqrt(np.nanmean(column))), float(low), float(high)))
    return Score(*out)


def simple(states: np.ndarray, segments: Segments) -> dict[str, float]:
    """Path and yaw rate of states (W, T+1, 3) beside their commands, by means over half a second."""
    rows = round(MEAN / segments.period)
    path = np.nansum(np.hypot(*np.moveaxis(np.diff(states[:, ::rows, :2], axis=1), 2, 0)))
    told = np.abs(segments.commands[..., 0]).sum() * segments.period
    late = [round(lag / segments.period) for lag in LAGS]
    most, steps = max(late), segments.commands.shape[1]
    turned = (states[:, most + rows :, 2] - states[:, most:-rows, 2]) / MEAN
    mean = np.cumsum(np.pad(segments.commands[..., 1], ((0, 0), (1, 0))), axis=1)
    slopes, left = [], []
    for lag in late:
        asked = (
            mean[:, most - lag + rows : steps + 1 - lag] - mean[:, most - lag : steps + 1 - lag - rows]
        ) / rows
        use = np.isfinite(turned)
        slope = float((asked[use] @ turned[use]) / (asked[use] @ asked[use]))
        slopes.append(slope)
        left.append(float(np.mean((turned[use] - slope * asked[use]) ** 2)))
    best = int(np.argmin(left))
    return {
        "path": float(path / told),
        "slope": slopes[best],
        "slope at once": slopes[0],
        "lag": float(LAGS[best]),
    }


def main() -> None:
    """Print the table and write benchmarks/results/diagnose_create.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--threshold-runs", type=int, default=20)
    given = parser.parse_args()
    logs = sorted((DATA / "utias_mrclam").glob("*.parquet"))
    if not logs:
        print("bench_diagnose_create: skipped, no log of the Create in DYNREG_DATA_DIR")
        return
    robot = load_robot("create")
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        log_map = robot.folder / "maps" / "utias_mrclam.toml"
        identity = reg.ingest(logs, "create", log_map=log_map, name="create").recording
        recording = halves(reg.registry.recording(identity))
        identity = reg.registry.put_recording(recording, robot.hash)
        began = time.perf_counter()
        found = reg.diagnose(
            identity, hold_out=HALVES[1], threshold_runs=given.threshold_runs, threads=given.threads
        )
        seconds = time.perf_counter() - began
        stored = lambda i: SimConfig.from_dict(reg.registry.simulator(i))  # noqa: E731
        configs = {
            "as commanded": SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal)),
            "calibrated": stored(found.calibrated_simulator),
            "extended": stored(found.extended_simulator),
        }
    segments = Segments.cut(robot, recording, [HALVES[1]], ROLLOUT, EVERY)
    states = {name: simulated(robot, config, segments) for name, config in configs.items()}
    errors = {name: squares(s, segments) for name, s in states.items()}
    draws = drawn(len(segments.measured))
    table = {name: score(e, draws) for name, e in errors.items()}
    means = {n: simple(s, segments) for n, s in {"measured": segments.measured, **states}.items()}
    report(found, table, means, _less(errors, draws), seconds)


def _less(errors: dict[str, np.ndarray], draws: np.ndarray) -> tuple[float, float, float]:
    """By which share the extended simulator's distance is less than the one as commanded, and its interval."""
    first, last = (errors[name][:, 0] for name in ("as commanded", "extended"))
    share = 1.0 - np.sqrt(np.nanmean(last[draws], axis=1) / np.nanmean(first[draws], axis=1))
    low, high = np.quantile(share, [0.05, 0.95])
    return 1.0 - float(np.sqrt(np.nanmean(last) / np.nanmean(first))), float(low), float(high)


def report(
    found, table: dict[str, Score], means: dict, less: tuple[float, float, float], seconds: float
) -> None:
    """Print the causes and the table, and keep both."""
    print(f"{found.verdict} in {seconds:.0f} s, threshold {found.threshold_nats:.1f} nats")
    for cause in found.causes:
        sizes = [
            f"{k} {v.value:.4g} ({v.low:.4g} to {v.high:.4g}) {v.unit}" for k, v in cause.parameters.items()
        ]
        alike = f"; cannot be told from {', '.join(cause.equivalent)}" if cause.equivalent else ""
        print(f"  {cause.key}, {', '.join(sizes)}; {cause.evidence_nats:.0f} nats{alike}")
    for name, p in found.parameters.items():
        print(f"  {name} {p.value:.4g} ({p.low:.4g} to {p.high:.4g}), stated {p.nominal:.4g}")
    print(f"\n{'10 s rollouts, second half':27s} {'distance':>25s} {'at the end':>25s} {'yaw':>25s}")
    for name, s in table.items():
        cells = [f"{100 * v:6.2f} [{100 * a:5.2f}, {100 * b:5.2f}] cm" for v, a, b in (s.distance, s.end)]
        v, a, b = np.degrees(s.yaw)
        print(f"{name:27s} {cells[0]:>25s} {cells[1]:>25s} {v:6.2f} [{a:5.2f}, {b:5.2f}] deg")
    print(
        f"extended: {100 * less[0]:.0f} % [{100 * less[1]:.0f}, {100 * less[2]:.0f}] less than as commanded"
    )
    for name, m in means.items():
        print(
            f"  {name:13s} path {m['path']:.3f} of the commanded, yaw rate {m['slope']:.3f} of its command"
            f" {m['lag']:.2f} s before ({m['slope at once']:.3f} of that at the same time)"
        )
    FILE.write_text(
        json.dumps(
            {
                "verdict": found.verdict,
                "threshold": found.threshold_nats,
                "causes": [c.to_dict() for c in found.causes],
                "parameters": {k: p.to_dict() for k, p in found.parameters.items()},
                "scores": {name: asdict(s) for name, s in table.items()},
                "less": less,
                "simple means": means,
                "seconds": seconds,
            },
            indent=1,
        )
        + "\n"
    )


if __name__ == "__main__":
    main()
