"""Backlash and elasticity in a joint of a quadruped whose legs hang free in turn: whether they are found, and where.

The robot's base is held on a stand, and the leg with the hidden effect plays the commands that `excite --legs` writes
for it; its log is diagnosed by that leg's joints, as the operator's note says. As many legs with nothing hidden play
theirs. The robot is measured as in bench_naming_quadruped; the truth runs with a time step ten times finer, nameplate
errors, a torque disturbance, sensor noise and quantisation.
"""

import json
import time
from dataclasses import replace

import numpy as np
from kept import RESULTS
from measured_quadruped import measured
from naming import TUNE, arguments, interval, seeds

from dynreg.diagnose.diagnose import Diagnosed, diagnose
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.threshold import USUAL
from dynreg.evidence.hypothesis import Hypothesis
from dynreg.evidence.lockstep import run
from dynreg.evidence.truth import Protocol, hide, log_of
from dynreg.excite.legs import AIMS, Hanging, HangingLegs, hanging_legs
from dynreg.results.trials import rate
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Term, term
from dynreg.sim.robot import load_robot

REPORT = 20261201
SIZES = ("strong", "medium")


def played(made: HangingLegs, hanging: Hanging, hidden: tuple[Term, ...], size: str | None, seed: int):
    """The hidden robot, and the log of its leg under the commands of the protocol."""
    begin = np.arange(hanging.run.episodes) * (hanging.run.steps * hanging.run.period + 1.0)
    truth = hide(made.robot, hidden, size, seed)
    return truth, log_of(made.robot, truth, Protocol(replace(hanging.run, begin=begin), hanging.names))


def named(made: HangingLegs, hanging: Hanging, log) -> Diagnosed:
    """The diagnosis of the leg's joints."""
    options = DiagnosisOptions(
        hold_out=",".join(hanging.held_out), joints=hanging.joints, threshold_runs=0, max_causes=1, threads=1
    )
    return run(diagnose(made.robot, log, options), threads=1)


def trial(made: HangingLegs, key: str | None, leg: str, size: str | None, seed: int) -> dict:
    """One leg's log and what was found in it, printed."""
    began, busy = time.perf_counter(), time.process_time()
    (hanging,) = [one for one in made.legs if one.leg == leg]
    hidden = (term(key),) if key else ()
    truth, log = played(made, hanging, hidden, size, seed)
    found = named(made, hanging, log)
    state, first = found.found, found.found.rounds[0].chosen
    name = first.point.hypothesis.terms[-1].key if state.accepted else None
    error = None
    if name == key and key:
        point = state.current
        alone = Hypothesis(point.hypothesis.terms)
        size_found = state.model.coordinates.effect_values(alone, point.effect[None])[0][0][0]
        error = float(abs(size_found / truth.values[0][0] - 1))
    out = {
        "hidden": key,
        "leg": leg,
        "size": size,
        "named": name,
        "verdict": found.verdict,
        "nats": None if first is None else first.nats,
        "error": error,
        "doubts": [f"{d.kind} {d.of} {d.value:.3g}" for d in found.doubts],
        "seconds": time.perf_counter() - began,
        "core_seconds": time.process_time() - busy,
    }
    said = (
        f"{key or 'nothing'} {size or ''} in {leg} -> {name} ({found.verdict}), {out['nats'] or 0:.1f} nats"
    )
    print(f"    {said}, error {error}, {out['core_seconds']:.0f} s {out['doubts']}", flush=True)
    return out


def main() -> None:
    """Print what was found and write benchmarks/results/hanging_legs.json."""
    parser = arguments(__doc__, none=10)
    parser.add_argument("--each", type=int, default=5, help="robots for each effect")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    began = time.perf_counter()
    made = hanging_legs(measured(load_robot("quadruped")), seed=0, threads=1)
    print(f"commands for {len(made.legs)} legs, {time.perf_counter() - began:.0f} s", flush=True)
    for one in made.legs:
        print(f"  {one.leg}: nats to expect at medium size {one.nats.round(1).tolist()}", flush=True)
    done = []
    for i in range(given.each):
        for n, name in enumerate(AIMS):
            rng = stream(seed, "hanging", name, i)
            hanging = made.legs[int(rng.integers(len(made.legs)))]
            key = f"{name}[{rng.choice(hanging.joints)}]"
            size = SIZES[(n + i) % 2]
            done.append(trial(made, key, hanging.leg, size, stream_seed(seed, "hanging", name, i) % 2**31))
    for i, own in enumerate(seeds(seed, "hanging", "none", n=given.none)):
        done.append(trial(made, None, made.legs[i % len(made.legs)].leg, None, own))
    confident = ("named", "ambiguous")
    shares = {
        "found": rate(d["named"] == d["hidden"] for d in done if d["hidden"]),
        "right": rate(d["named"] == d["hidden"] and d["verdict"] in confident for d in done if d["hidden"]),
        "false_alarm": rate(d["named"] is not None for d in done if not d["hidden"]),
    }
    for name, share in shares.items():
        if share is not None:
            print(f"  {name}: {interval(share)}")
    if given.write and not given.tune:
        document = {
            "threshold": USUAL,
            **{k: v and v.to_dict() for k, v in shares.items()},
            "trials": done,
        }
        (RESULTS / "hanging_legs.json").write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
