"""Populations of a thousand to tens of thousands: what an entry costs, what retrieval finds, what more of them bring.

The population grows from one n to the next, so that seconds an entry are those of growing. At each n: seconds by phase,
bytes by folder, peak memory; retrieval on robots of the family that are no entries (and on real logs where the robot
has some), by the search for the nearest and by brute force on the same rows; and, for the same robots, the rollout
error of what was retrieved, replayed and synthesised on commands that nobody saw (a random entry = 1.00).

Every step is a line of the journal: a second start goes on. Robots for reporting have seeds of their own (`REPORT`),
apart from those used in development (`TUNE`).
"""

import argparse
import json
import resource
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hidden import Hidden, errors_of, hidden_robots
from journal import Journal
from kept import RESULTS

import dynreg
from dynreg.data.recording import Recording
from dynreg.distance.query import DistanceQuery, Ranked
from dynreg.distance.table import DISTANCES
from dynreg.replay.cut import windows
from dynreg.replay.known import known_values
from dynreg.replay.windows import Replayer, errors
from dynreg.rng import stream
from dynreg.session import Session
from dynreg.sim.excitation import excitation
from dynreg.verbs.populations import load_population
from dynreg.verbs.query import QuerySettings, query
from dynreg.verbs.subjects import Recorded, read_log

TUNE, REPORT = 777, 20261126
HERE = Path(__file__).parent
REAL = {
    "servo_pendulum": "bam_xl330_pendulum/raw/*.json"
}  # logs of real robots, in the folder of measured data
K, AGAIN = 5, 3  # nearest that are compared; times that a search is timed


def populate(session: Session, robot: str, n: int) -> dict[str, Any]:
    """What the entries cost that were added to reach n."""
    told = session.populate(robot, n)
    each = max(told.added, 1)
    size = {
        folder.name: sum(f.stat().st_size for f in folder.iterdir() if f.is_file()) / told.entries
        for folder in (session.path / "shards", session.path / "index")
    }
    return {
        "population": told.population,
        "added": told.added,
        "seconds": told.seconds,
        "simulate ms": 1e3 * told.simulate_seconds / each,
        "train ms": 1e3 * told.train_seconds / each,
        "link ms": 1e3 * told.link_seconds / each,
        "evaluations": told.evaluations / each,
        "bytes": size,
        "peak GB": peak(),
    }


def peak() -> float:
    """The most memory that this process had [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def asked(population, log: Recording, **how: Any) -> DistanceQuery:
    """The query of a log, all of which is read."""
    robot = population.shared.robot
    replayer = Replayer(robot, windows(robot, log))
    every = np.arange(len(replayer.windows))

    def replayed(unit: np.ndarray) -> np.ndarray:
        values = robot.space.from_unit(unit)
        return errors(replayer.residuals(values, every)).mean(axis=1)

    return DistanceQuery(population, log, replayed, known_values(robot, log), at_least=K, **how)


def found(query: DistanceQuery, distance: str) -> tuple[Ranked, dict[str, float]]:
    """What a distance finds; its milliseconds, and those of processors, once the files and the models are warm."""
    DISTANCES[distance].rank(query)
    seconds = []
    for _ in range(1 if query.exact else AGAIN):
        began = time.perf_counter(), time.process_time()
        ranked = DISTANCES[distance].rank(query)
        seconds.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    wall, processors = np.min(seconds, axis=0)
    return ranked, {"ms": 1e3 * wall, "processor ms": 1e3 * processors}


def retrieve(population, log: Recording) -> dict[str, Any]:
    """Recall@5 against brute force on the same rows, evaluations and milliseconds of each way, and replay errors."""
    row: dict[str, Any] = {}
    searching = asked(population, log)
    exact, nearest = replace(searching, exact=True), {}
    for distance in ("one_sided", "cross_loss"):
        right, slow = found(exact, distance)
        ranked, quick = found(searching, distance)
        wanted, got = right.order[:K], ranked.order[:K]
        row[distance] = {
            "recall": len(set(wanted) & set(got)) / K,
            "evaluations": ranked.evaluations,
            "allowed": right.evaluations,
            **quick,
            "brute force": slow,
        }
        nearest |= {distance: got, f"{distance}, brute force": wanted}
    by_vectors, quick = found(searching, "embedding")
    row["embedding"] = quick
    nearest["embedding"] = by_vectors.order[:K]
    both = np.unique(np.concatenate(list(nearest.values())))
    error = dict(zip(both.tolist(), searching.replayed(population.unit[both]).tolist(), strict=True))
    row["replay error"] = {name: float(np.mean([error[i] for i in ids])) for name, ids in nearest.items()}
    return row | {"peak GB": peak()}


def quality(session: Session, population, hidden: Hidden, log: Recording) -> dict[str, Any]:
    """Rollout errors of what a query finds, relative to random entries."""
    robot, entries = population.shared.robot, population.entries
    random = stream(hidden.seed, "random", hidden.number).permutation(len(population))[:25]
    chosen = {
        "nominal": robot.space.nominal[None],
        "random": entries.values[random],
        "itself": hidden.values[None, : len(robot.space)],
    }
    for distance in ("one_sided", "embedding"):
        ranked = DISTANCES[distance].rank(asked(population, log))
        chosen[distance] = entries.values[ranked.order[:K]]
    subject = Recorded(session.registry, robot, log, log.id[:12])
    answer = query(subject, QuerySettings(hold_out="0"), population=population)
    place = {entry: i for i, entry in enumerate(entries.ids)}
    chosen["replayed"] = entries.values[[place[n.entry] for n in answer.neighbours]]
    if answer.synthesised is not None:
        made = {name: p.value for name, p in answer.synthesised.parameters.items()}
        chosen["synthesised"] = robot.space.from_dict(made)[None]
    chosen["answer"] = robot.space.from_dict(answer.answer_parameters)[None]
    found = errors_of(population, hidden, chosen)
    return {name: error / found["random"] for name, error in found.items()} | {
        "seconds": answer.cost.seconds,
        "evaluations": answer.cost.evaluations,
    }


def real_logs(robot: str) -> Iterator[tuple[str, Path]]:
    """Names and paths of the measured logs of a robot."""
    from os import environ

    folder = Path(environ.get("DYNREG_DATA_DIR", HERE.parents[1] / "shared" / "data"))
    for path in sorted(folder.glob(REAL[robot])) if robot in REAL else ():
        yield path.stem, path


def run(session: Session, journal: Journal, given: argparse.Namespace, n: int) -> None:
    """The steps at one n that the journal does not hold yet."""
    done = {(line["n"], line["step"]) for line in journal.lines()}

    def step(name: str, make) -> None:
        if (n, name) not in done:
            began = time.perf_counter()
            line = journal.add({"n": n, "step": name, **make()})
            print(f"{n} {name} ({time.perf_counter() - began:.0f} s): {json.dumps(line)}", flush=True)

    step("populate", lambda: populate(session, given.robot, n))
    (identity,) = (
        line["population"] for line in journal.lines() if (line["n"], line["step"]) == (n, "populate")
    )
    population = load_population(session.registry, identity, states=given.quality, judged=True)
    robot = population.shared.robot
    for hidden in hidden_robots(robot, given.robots, TUNE if given.tune else REPORT):
        own = excitation(robot, seed=hidden.seed, name=f"own {hidden.number}")
        log = hidden.log(own, "own")
        step(f"fresh {hidden.number}", lambda log=log: retrieve(population, log))
        if given.quality and hidden.number < given.quality:
            step(
                f"quality {hidden.number}",
                lambda h=hidden, log=log: quality(session, population, h, log),
            )
    for name, path in list(real_logs(given.robot))[: given.logs]:
        step(f"real {name}", lambda path=path: retrieve(population, read_log(path, robot)))


def main() -> None:
    """Run what is missing of the table, print it and write benchmarks/results/scale_ROBOT.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--n", type=int, nargs="+", default=[1000, 3000, 10000])
    parser.add_argument("--robot", default="quadruped")
    parser.add_argument("--robots", type=int, default=10, help="that retrieval is measured on")
    parser.add_argument("--quality", type=int, default=10, help="of them, whose rollouts are compared")
    parser.add_argument("--logs", type=int, help="measured logs that are asked about; all by default")
    parser.add_argument("--tune", action="store_true", help="the robots for development")
    parser.add_argument("--registry", type=Path)
    parser.add_argument("--journal", type=Path)
    given = parser.parse_args()
    place = given.registry or HERE / f"registry-scale-{given.robot}"
    seeds = TUNE if given.tune else REPORT
    path = given.journal or HERE / "registry" / f"scale_{given.robot}_{seeds}.jsonl"
    journal = Journal(path, {"robot": given.robot, "seed": seeds})
    journal.begin()
    with dynreg.open(place) as session:
        for n in sorted(given.n):
            run(session, journal, given, n)
    rows = summary(journal.lines())
    print(json.dumps(rows, indent=1))
    if not given.tune:
        RESULTS.mkdir(exist_ok=True)
        out = RESULTS / f"scale_{given.robot}.json"
        out.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


def summary(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row for each n: what its entries cost, and means over robots and over real logs."""
    rows = []
    for n in dict.fromkeys(line["n"] for line in lines):
        mine = [line for line in lines if line["n"] == n]
        row = {"n": n, "populate": next(line for line in mine if line["step"] == "populate")}
        for kind in ("fresh", "quality", "real"):
            some = [line for line in mine if line["step"].startswith(kind)]
            if some:
                row[kind] = mean(some) | {"count": len(some)}
        rows.append(row)
    return rows


def mean(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Means of all numbers, however deep, each over the rows that have it; `n` and names are left out."""
    out: dict[str, Any] = {}
    for key in dict.fromkeys(key for row in rows for key in row):
        column = [row[key] for row in rows if key in row]
        if isinstance(column[0], dict):
            out[key] = mean(column)
        elif isinstance(column[0], int | float) and key != "n":
            out[key] = float(np.mean(column))
    return out


if __name__ == "__main__":
    main()
