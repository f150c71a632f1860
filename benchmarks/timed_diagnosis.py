"""What `bench_diagnose_speed.py` times, in a process of its own: `timed_diagnosis.py JOB.json`, the answers on stdout.

Only the public door is used (`dynreg.open`, `ingest`, `diagnose`; `rollout` of an engine), so that the same file runs
with any checkout of dynreg that PYTHONPATH names. Process time counts, as other processes share the cores; wall time
is told beside it.
"""

import contextlib
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import dynreg
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.run import Run

LEAST = 0.3  # s that an engine is timed for


def write_log(recording: dynreg.Recording, path: Path) -> None:
    """A recording as a file of arrays, to the bit."""
    episodes = recording.episodes
    head = {
        "channels": [[c.name, c.unit] for c in recording.channels],
        "episodes": [[e.name, dict(e.settings)] for e in episodes],
        "measured": recording.measured,
    }
    arrays = {f"time_{i}": e.time for i, e in enumerate(episodes)}
    arrays |= {f"values_{i}": e.values for i, e in enumerate(episodes)}
    np.savez(path, head=json.dumps(head), **arrays)


def read_log(path: Path) -> dynreg.Recording:
    """The recording of `write_log`."""
    with np.load(path, allow_pickle=False) as held:
        head = json.loads(str(held["head"]))
        episodes = [
            dynreg.Episode(name, held[f"time_{i}"], held[f"values_{i}"], settings)
            for i, (name, settings) in enumerate(head["episodes"])
        ]
    channels = tuple(dynreg.Channel(*c) for c in head["channels"])
    return dynreg.Recording(channels, tuple(episodes), head["measured"])


def diagnoses(job: dict[str, Any]) -> list[dict[str, Any]]:
    """The answers to what the job asks of its logs, one after the other in one new registry."""
    robot = dynreg.load_robot(job["robot"])
    with tempfile.TemporaryDirectory() as folder, dynreg.open(folder) as reg:
        logs = [reg.ingest(read_log(Path(p)), robot, name=f"log_{i}") for i, p in enumerate(job["logs"])]
        told = {"hold_out": job["hold_out"], "tolerance": job["tolerance"], "seed": 0, "threads": 1}
        load(reg, robot, told)
        return [asked(reg, logs[one["log"]].recording, one, told) for one in job["asks"]]


def load(reg: dynreg.Session, robot: Any, told: dict[str, Any]) -> None:
    """Import and compile what is so at first use, before a clock runs: a diagnosis that is refused, and rollouts."""
    with contextlib.suppress(dynreg.DynregError):
        reg.diagnose("log_0", **told, effects=("wheel_slip",))  # no robot here is a planar base
    run = Run(np.zeros((1, 2, len(robot.actions))), period=1.0 / robot.rate)
    for terms in (None, shared([("coulomb_friction", [0.0])], 1)):
        rollout(robot, robot.space.nominal[None], run, terms=terms, threads=1)


def asked(reg: dynreg.Session, recording: str, one: dict[str, Any], told: dict[str, Any]) -> dict[str, Any]:
    """One diagnosis: its times [s], those at which its stages were last heard of, and what it says."""
    began, busy = time.perf_counter(), time.process_time()
    stages: dict[str, float] = {}

    def hear(stage: str, *_: int) -> None:
        stages[stage] = round(time.process_time() - busy, 3)

    found = reg.diagnose(recording, **told | one["settings"], progress=hear)
    spent = time.process_time() - busy, time.perf_counter() - began
    return {
        "case": one["case"],
        "hides": one["hides"],
        "process": spent[0],
        "wall": spent[1],
        "stages": stages,
        "recording": found.recording,
        "verdict": found.verdict,
        "causes": [c.key for c in found.causes],
        "nats": [c.evidence_nats for c in found.causes],
        "threshold": found.threshold_nats,
        "rollouts": found.cost.rollouts,
    }


def rates(job: dict[str, Any]) -> list[dict[str, Any]]:
    """Time steps a second of an engine: so many candidates at once, that have so many effects between them."""
    robot = dynreg.load_robot(job["robot"])
    with np.load(job["commands"], allow_pickle=False) as held:
        run = Run(held["actions"], period=float(held["period"]))
    out = []
    for width in job["widths"]:
        for effects in job["effects"]:
            values, terms = np.tile(robot.space.nominal, (width, 1)), shared(effects, width)
            how = {"engine": job["engine"], "terms": terms, "threads": 1}
            rollout(robot, values, Run(run.actions[:, :2], period=run.period), **how)
            steps, busy = 0, time.process_time()
            while (spent := time.process_time() - busy) < LEAST:
                steps += rollout(robot, values, run, **how).physics_steps
            out.append({"width": width, "effects": len(effects), "rate": steps / spent})
    return out


def shared(effects: list[tuple[str, list[float]]], width: int) -> Terms | None:
    """These effects in so many candidates: every candidate has one or more, and every effect is in one or more."""
    if not effects:
        return None
    values = [np.full((width, len(row)), np.nan) for _, row in effects]
    for i in range(max(len(effects), width)):
        which = i % len(effects)
        values[which][i % width] = effects[which][1]
    return Terms(tuple(term(key) for key, _ in effects), tuple(values))


def main() -> None:
    """Do the job of the file that is named; write where dynreg lies and the answers, as JSON, on the last line."""
    job = json.loads(Path(sys.argv[1]).read_text())
    answers = rates(job) if "widths" in job else diagnoses(job)
    print(json.dumps({"dynreg": dynreg.__file__, "answers": answers}))


if __name__ == "__main__":
    main()
