"""What it costs that every byte of a registry is compared with its hash before it is used.

    python benchmarks/bench_registry_checks.py --against CHECKOUT [--entries 4000] [--rounds 7]

Each of two checkouts of dynreg, this one and an older one, populates a registry of its own; then processes of both, in
turn, open their registry, load the population and query a log, twice each, the second time from a new session. The
first call of a process pays for loading libraries and for reading the files whole; the second for neither.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from kept import RESULTS
from servo_log import write_log

HERE = Path(__file__).parent
STEPS = ("open", "load", "query")
CHILD = """
import json, sys, time
from pathlib import Path
import dynreg
from dynreg.verbs import populations
from dynreg.verbs.subjects import recorded
place, what, n, log = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4]
assert Path(dynreg.__file__).is_relative_to(sys.argv[5]), dynreg.__file__
if what == "populate":
    clock = time.process_time()
    with dynreg.open(place) as reg:
        made = reg.populate("servo_pendulum", n)
        reg.ingest(log, "servo_pendulum", name="run")
    print(json.dumps({"populate": time.process_time() - clock, "wall": made.seconds}))
else:
    told = []
    for call in range(3):
        clocks = [time.process_time()]
        with dynreg.open(place, create=False) as reg:
            clocks.append(time.process_time())
            populations.ready(recorded(reg.registry, "run", ingest=False), None)
            clocks.append(time.process_time())
            reg.query("run", budget=16)
        clocks.append(time.process_time())
        told.append([b - a for a, b in zip(clocks, clocks[1:])])
    print(json.dumps(told))
"""


def main() -> None:
    """Print the table and write benchmarks/results/registry_checks.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--against", type=Path, help="an older checkout of dynreg; else this one alone is timed"
    )
    parser.add_argument("--entries", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    places = {"before": given.against, "now": HERE.parent}
    places = {side: place.resolve() for side, place in places.items() if place is not None}
    with tempfile.TemporaryDirectory() as folder:
        log = write_log(Path(folder))
        told = {
            side: asked(place, folder, side, "populate", given.entries, log) for side, place in places.items()
        }
        rounds = []
        for number in range(given.rounds):
            order = list(places.items())[:: -1 if number % 2 else 1]
            rounds.append({s: asked(place, folder, s, "query", given.entries, log) for s, place in order})
            print(f"round {number + 1}: " + json.dumps(rounds[-1]), flush=True)
    out = {"entries": given.entries, "populate": told, "calls": table(rounds)}
    print_table(out)
    if given.against:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "registry_checks.json").write_text(json.dumps(out, indent=1) + "\n")


def asked(place: Path, folder: str, side: str, what: str, entries: int, log: Path) -> list | dict:
    """What a process that runs the checkout at `place` says of its registry."""
    one_core = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    done = subprocess.run(
        [sys.executable, "-c", CHILD, f"{folder}/{side}", what, str(entries), str(log), str(place)],
        cwd=place,
        env=os.environ | one_core | {"PYTHONPATH": str(place)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def table(rounds: list[dict]) -> dict[str, dict[str, dict[str, float]]]:
    """{call: {step: {side: median s}}}; calls after the second are its repetitions."""
    out: dict[str, dict[str, dict[str, float]]] = {}
    for call, numbers in {"first": (0,), "second": (1, 2)}.items():
        for i, step in enumerate((*STEPS, "all")):
            out.setdefault(call, {})[step] = {
                side: median(
                    sum(r[side][n]) if step == "all" else r[side][n][i] for r in rounds for n in numbers
                )
                for side in rounds[0]
            }
    return out


def print_table(out: dict) -> None:
    """Medians in seconds of process time, and their ratios."""
    populate = {side: told["populate"] for side, told in out["populate"].items()}
    print(
        f"\n{out['entries']} entries"
        + " " * 14
        + "".join(f"{side + ' s':>10}" for side in populate)
        + "     ratio"
    )
    rows = [("populate and ingest", populate)]
    rows += [
        (f"{call} call, {step}", sides)
        for call, steps in out["calls"].items()
        for step, sides in steps.items()
    ]
    for name, sides in rows:
        ratio = f"{sides['now'] / sides['before']:10.2f}" if "before" in sides else ""
        print(f"{name:26}" + "".join(f"{seconds:10.3f}" for seconds in sides.values()) + ratio)


if __name__ == "__main__":
    main()
