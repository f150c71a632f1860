"""How long diagnoses take on one core, and the time steps a second of the engines that they run on.

`--against CHECKOUT` runs every case in another checkout of dynreg, too, in turn with this one: each time in a new
process, on the same logs, by the public door alone (`timed_diagnosis.py`). Ratios are of process times, as the cores
may be shared; wall times are kept beside them. What is imported and compiled at first use is loaded before the clock
runs. Logs of simulated robots are those of the naming benchmarks' development, their thresholds the usual one but on
the servo bench. The times are of whole answers: with intervals, where the errors lie, what is left, and the rivals of a
cause. Beside them stands when the causes were named, which is most of what the clocks of the naming benchmarks count.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from diagnosis_jobs import jobs
from journal import Journal
from kept import RESULTS

HERE = Path(__file__).parent
NOW, BEFORE = "now", "before"
AIMS = {
    "XL330": 20.0,
    "XL330, threshold sought": 60.0,
    "XL330, threshold kept": 20.0,
    "servo, threshold sought": None,
    "servo, next recording of the same commands": 2.0,
    "servo, threshold kept": 2.0,
    "leg in the air": 10.0,
    "leg on the ground": 25.0,
    "quadruped": 80.0,
}  # s of one core
ONE_CORE = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}


def main() -> None:
    """Print times as they come, then tables; write benchmarks/results/diagnose_speed.json where nothing is left out."""
    given = _arguments()
    places = {BEFORE: given.against, NOW: HERE.parent}
    places = {side: place.resolve() for side, place in places.items() if place is not None}
    code = {side: digest(place) for side, place in places.items()}
    journal = Journal(given.journal, code) if given.journal else None
    if journal:
        journal.begin()
    with tempfile.TemporaryDirectory() as folder:
        diagnosed, rated = [], []
        for job in jobs(Path(folder), given):
            answers = {
                side: done(job, place, side, Path(folder), journal)
                for side, place in _in_turn(places, len(diagnosed) + len(rated))
            }
            if "widths" in job:
                rated.append((job, answers))
                continue
            for one in zip(*(answers[side] for side in places), strict=True):
                diagnosed.append(dict(zip(places, one, strict=True)))
                print(told(diagnosed[-1]), flush=True)
    out = {"code": code, "cases": case_rows(diagnosed), "rates": rate_rows(rated), "answers": diagnosed}
    print_cases(out["cases"])
    print_rates(out["rates"])
    if not given.quick and given.only is None:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "diagnose_speed.json").write_text(json.dumps(out, indent=1) + "\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--against", type=Path, help="another checkout of dynreg, timed in turn with this one"
    )
    parser.add_argument("--quick", action="store_true", help="no quadruped, no threshold of the XL330")
    parser.add_argument(
        "--only", nargs="*", help="cases whose names begin so; `rates` for those of the engines"
    )
    parser.add_argument("--logs", type=int, help="hidden effects of a leg or quadruped; 5, with --quick 2")
    parser.add_argument(
        "--journal", type=Path, help="file of the steps that are done: a second start goes on"
    )
    given = parser.parse_args()
    given.logs = given.logs or (2 if given.quick else 5)
    return given


def _in_turn(places: dict[str, Path], number: int) -> list[tuple[str, Path]]:
    """The checkouts, each first every second time: a machine that warms up favours none."""
    return list(places.items())[:: -1 if number % 2 else 1]


def done(
    job: dict[str, Any], place: Path, side: str, folder: Path, journal: Journal | None
) -> list[dict[str, Any]]:
    """The answers to a job, asked of the checkout at `place` in a process of its own; those in the journal are kept.

    Raises SystemExit where the process fails, or runs another dynreg than that of the checkout.
    """
    lines = journal.lines() if journal else []
    step = json.loads(json.dumps({"side": side, "job": job}))
    known = [line["answers"] for line in lines if line["step"] == step]
    if known:
        return known[-1]
    asked = folder / "job.json"
    asked.write_text(json.dumps(job), encoding="utf-8")
    command = [sys.executable, str(HERE / "timed_diagnosis.py"), asked.name]
    world = os.environ | ONE_CORE | {"PYTHONPATH": str(place)}
    ran = subprocess.run(command, cwd=folder, env=world, stdout=subprocess.PIPE, text=True, check=False)
    if ran.returncode:
        raise SystemExit(f"{place}: {job['robot']} failed with exit status {ran.returncode}")
    said = json.loads(ran.stdout.splitlines()[-1])
    if not Path(said["dynreg"]).is_relative_to(place):
        raise SystemExit(f"{place}: the process ran {said['dynreg']}")
    for one in said["answers"]:
        if "recording" in one and one["recording"] not in job["recordings"]:
            raise SystemExit(f"{place}: diagnosed another recording than was written")
    if journal:
        journal.add({"step": step, "answers": said["answers"]})
    return said["answers"]


def digest(place: Path) -> str:
    """Of the code and the robots of a checkout."""
    out = hashlib.sha256()
    for path in sorted((place / "dynreg").rglob("*")):
        if path.suffix in (".py", ".toml", ".xml"):
            out.update(str(path.relative_to(place)).encode() + path.read_bytes())
    return out.hexdigest()


def told(one: dict[str, dict]) -> str:
    """A line about one diagnosis: times of each checkout, what it says, and whether both say the same."""
    case, hidden = one[NOW]["case"], one[NOW]["hides"]
    name = f"{case}, hides {hidden}" if hidden else case
    said = [
        f"{side} {a['process']:.1f} s (wall {a['wall']:.1f}), {a['verdict']}: {', '.join(a['causes']) or 'no cause'}"
        for side, a in one.items()
    ]
    return f"{name}: {'; '.join(said)}{'' if same(one) else '; THEY DIFFER'}"


def same(one: dict[str, dict]) -> bool:
    """Whether all checkouts give the same verdict and the same causes in the same order."""
    return len({(a["verdict"], *a["causes"]) for a in one.values()}) == 1


def case_rows(diagnosed: Sequence[dict[str, dict]]) -> dict[str, dict[str, Any]]:
    """Of each case its aim, median and largest times [s] of each checkout, how many times as fast, and what differs."""
    out = {}
    for case in dict.fromkeys(one[NOW]["case"] for one in diagnosed):
        mine = [one for one in diagnosed if one[NOW]["case"] == case]
        row: dict[str, Any] = {"aim": AIMS[case], "diagnoses": len(mine)}
        for side in mine[0]:
            for clock in ("process", "wall"):
                spent = [one[side][clock] for one in mine]
                row[f"{side} {clock}"] = {"median": median(spent), "largest": max(spent)}
            row[f"{side} named"] = median(one[side]["stages"]["causes"] for one in mine)
        if BEFORE in mine[0]:
            row["faster"] = median(one[BEFORE]["process"] / one[NOW]["process"] for one in mine)
            row["differ"] = [one[NOW]["hides"] or case for one in mine if not same(one)]
        out[case] = row
    return out


def print_cases(found: dict[str, dict[str, Any]]) -> None:
    """A line for each case: process and wall times, median and largest."""
    if not found:
        return
    print(
        f"\n{'diagnoses on one core [s], process (wall)':44s} {'before':>24s} {'now':>24s}  faster    aim"
        "    named after"
    )
    for case, row in found.items():
        cells = [_times(row, side) for side in (BEFORE, NOW)]
        faster = f"{row['faster']:.2f}" if "faster" in row else "-"
        aim = "-" if row["aim"] is None else f"{row['aim']:.0f} {_met(row)}"
        differ = f"  DIFFER: {', '.join(row['differ'])}" if row.get("differ") else ""
        name = f"{case}, {row['diagnoses']}" if row["diagnoses"] > 1 else case
        print(f"{name:44s} {cells[0]:>24s} {cells[1]:>24s} {faster:>7s} {aim:>10s}{_named(row):>15s}{differ}")


def _times(row: dict[str, Any], side: str) -> str:
    if f"{side} process" not in row:
        return "-"
    spent, wall = row[f"{side} process"], row[f"{side} wall"]
    most = f" to {spent['largest']:.1f}" if row["diagnoses"] > 1 else ""
    return f"{spent['median']:.1f}{most} ({wall['median']:.1f})"


def _named(row: dict[str, Any]) -> str:
    return " -> ".join(f"{row[f'{side} named']:.1f}" for side in (BEFORE, NOW) if f"{side} named" in row)


def _met(row: dict[str, Any]) -> str:
    return "met" if row[f"{NOW} process"]["median"] <= row["aim"] else "not met"


def rate_rows(rated: Sequence[tuple[dict[str, Any], dict[str, list[dict]]]]) -> list[dict[str, Any]]:
    """Of each engine, width and number of effects the best rate [steps/s] of each checkout."""
    best: dict[tuple, dict[str, float]] = {}
    for job, answers in rated:
        for side, rows in answers.items():
            for row in rows:
                key = (job["robot"], job["engine"], row["width"], row["effects"])
                known = best.setdefault(key, {})
                known[side] = max(known.get(side, 0.0), row["rate"])
    names = ("robot", "engine", "width", "effects")
    return [dict(zip(names, key, strict=True)) | row for key, row in best.items()]


def print_rates(found: Sequence[dict[str, Any]]) -> None:
    """A table for each engine: a line for each width, a column for each number of effects."""
    for robot, engine in dict.fromkeys((r["robot"], r["engine"]) for r in found):
        mine = [r for r in found if (r["robot"], r["engine"]) == (robot, engine)]
        effects = list(dict.fromkeys(r["effects"] for r in mine))
        print(f"\n{engine} engine, {robot}: million time steps/s by the effects among so many candidates")
        print(f"{'candidates':>10s} " + " ".join(f"{f'{n} effects':>22s}" for n in effects))
        for width in dict.fromkeys(r["width"] for r in mine):
            row = {r["effects"]: r for r in mine if r["width"] == width}
            print(f"{width:10d} " + " ".join(f"{_rate(row[n]):>22s}" for n in effects))


def _rate(row: dict[str, Any]) -> str:
    now = f"{row[NOW] / 1e6:.3f}"
    if BEFORE not in row:
        return now
    return f"{row[BEFORE] / 1e6:.3f} -> {now} ({row[NOW] / row[BEFORE]:.2f})"


if __name__ == "__main__":
    main()
