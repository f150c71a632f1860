"""Searches for a gait in the true simulator of quadrupeds, without the gaits that the robot's folder brings.

Robots are drawn from the population's ranges until enough of them walk (`ABLE` metres, no fall) with the best of the
packaged gaits; how many were refused is printed. Each way gets the same number of gaits of 10 s: the best of them are
tried again with other motor noise, and the answer is judged by noise that nothing has seen, as the packaged gait is.
A way reaches the packaged gait with the first gait that is worth as much under the search's own noise.

Every finished cell is a line of the journal; a second start goes on. `--tune` takes the robots of the development.
"""

import argparse
import json
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from journal import Journal
from kept import RESULTS

from dynreg.gait.seek import SearchSettings, search_of
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Simulators, Trials
from dynreg.results.trials import rate
from dynreg.rng import stream, stream_seed
from dynreg.search.drive import Limits, Search, drive
from dynreg.search.hill import HillClimber
from dynreg.search.screened import after
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES
from dynreg.sim.robot import load_robot

TUNE, REPORT = 611, 20261208
RATE = 36.0  # Hz
ABLE = 0.3  # m in 10 s, the task's success
DRAWS = 400  # of robots
FINALISTS, AGAIN, JUDGED = (
    5,
    4,
    6,
)  # gaits tried again, by so many draws of the noise; draws that judge the answer
CLIMBERS = 50  # of the paper's hill climber
SHARE = 0.2  # of the gaits that are drawn before a single run sets out


def _anywhere(trials: Trials, gaits: int, seed: int) -> Search:
    """CMA-ES from the best of draws of the whole ranges: what the search was before."""
    rng = stream(seed, "anywhere")
    return _one_run(trials, rng.uniform(size=(_screened(gaits), len(trials.space))), rng)


def _about_rest(trials: Trials, gaits: int, seed: int) -> Search:
    """The same from draws that swing a little about the pose at rest."""
    settings = SearchSettings(rollouts=gaits, seed=seed, packaged=False)
    return search_of(trials, settings, gaits, most=1)


def _one_run(trials: Trials, candidates: np.ndarray, rng: np.random.Generator) -> Search:
    kind = SEARCHES["cma"]
    return after(candidates, kind, Start(len(trials.space), rng, kind.batch, periodic=trials.space.periodic))


def _screened(gaits: int) -> int:
    batch = SEARCHES["cma"].batch
    return int(SHARE * gaits) // batch * batch


def _race(trials: Trials, gaits: int, seed: int) -> Search:
    """The search of `dynreg gait` without the packaged gaits, under one noise."""
    return search_of(trials, SearchSettings(rollouts=gaits, seed=seed, packaged=False), gaits)


def _with_packaged(trials: Trials, gaits: int, seed: int) -> Search:
    """The search of `dynreg gait`, under one noise."""
    return search_of(trials, SearchSettings(rollouts=gaits, seed=seed), gaits)


def _hill(trials: Trials, gaits: int, seed: int) -> Search:
    """The paper's hill climber with 50 starts."""
    space = trials.space
    rng = stream(seed, "hill")
    return HillClimber(len(space), rng=rng, restarts=CLIMBERS, periodic=space.periodic)


WAYS: dict[str, Callable[[Trials, int, int], Search]] = {
    "hill climber, 50 starts (paper)": _hill,
    "draws anywhere, one run": _anywhere,
    "draws about rest, one run": _about_rest,
    "draws about rest, race of four": _race,
    "the same, with the packaged gaits": _with_packaged,
}


@dataclass(frozen=True, eq=False)
class Cell:
    """A robot (P,), its number among the draws, and a way with so many gaits."""

    number: int
    values: np.ndarray
    way: str
    gaits: int
    seed: int


def trials_of(values: np.ndarray, seed: int) -> Trials:
    """A robot's own simulator."""
    robot = load_robot("quadruped")
    return Trials(robot, task_of(robot), Simulators(values[None]), rate=RATE, seed=seed, threads=1)


def draws(seed: int) -> np.ndarray:
    """(DRAWS, P) of robots."""
    space = load_robot("quadruped").space
    out = space.sample(0, DRAWS, seed)
    out[:, space.names.index("action_rate")] = RATE
    return out


def packaged(trials: Trials) -> tuple[float, float]:
    """What the best packaged gait is worth under the search's own noise, and judged as answers are."""
    space = trials.space
    genes = space.feasible(space.from_unit(space.starts))
    own = fitness(trials.grades(genes))[:, 0]
    best = genes[[int(own.argmax())]]
    return float(own.max()), float(judged(trials, best)[0])


def judged(trials: Trials, genes: np.ndarray) -> np.ndarray:
    """(n,) mean fitness of gaits (n, G) under noise that no search has seen."""
    return fitness(trials.again(genes, JUDGED, first=1000)).mean(axis=(1, 2))


def work(cell: Cell) -> dict:
    """One way on one robot."""
    trials = trials_of(cell.values, stream_seed(cell.seed, "robot", cell.number) % 2**31)
    goal, _ = packaged(trials)
    space, began = trials.space, time.process_time()
    seed = stream_seed(cell.seed, "search", cell.number) % 2**31
    seen: list[tuple[float, np.ndarray]] = []
    first: list[tuple[int, float]] = []

    def grades(unit: np.ndarray) -> np.ndarray:
        genes = space.feasible(space.from_unit(unit))
        found = trials.grades(genes)
        for one, gait in zip(fitness(found)[:, 0], genes, strict=True):
            seen.append((float(one), gait))
            if one >= goal and not first:
                first.append((len(seen), time.process_time() - began))
        return found

    def judge(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return fitness(found)[:, 0], -found[:, 0]

    drive(WAYS[cell.way](trials, cell.gaits, seed), grades, judge, Limits(cell.gaits))
    best = np.array([gait for _, gait in sorted(seen, key=lambda s: -s[0])[:FINALISTS]])
    again = fitness(trials.again(best, AGAIN)).mean(axis=(1, 2))
    answer = best[[int(again.argmax())]]
    return {
        "value": float(judged(trials, answer)[0]),
        "search": seen and max(v for v, _ in seen),
        "reached": first[0][0] if first else None,
        "reached_core": first[0][1] if first else None,
        "gaits": len(seen),
        "core": time.process_time() - began,
    }


def table(done: dict[tuple[int, str], dict], robots: dict[int, float], ways: list[str]) -> dict:
    """{way: figures} over the robots that have all ways."""
    whole = [n for n in robots if all((n, way) in done for way in ways)]
    goal = np.array([robots[n] for n in whole])
    out: dict[str, dict] = {"the best packaged gait, by trial": {"m": float(np.median(goal))}}
    for way in ways:
        mine = [done[n, way] for n in whole]
        value = np.array([c["value"] for c in mine])
        reached = [c["reached"] for c in mine if c["reached"] is not None]
        out[way] = {
            "m": float(np.median(value)),
            "share": float(np.median(value / goal)),
            "as_good": rate(v >= g for v, g in zip(value, goal, strict=True)).to_dict(),
            "reached": rate(c["reached"] is not None for c in mine).to_dict(),
            "gaits_to_reach": float(np.median(reached)) if reached else None,
            "core_to_reach": float(
                np.median([c["reached_core"] for c in mine if c["reached_core"] is not None])
            )
            if reached
            else None,
            "core": float(np.median([c["core"] for c in mine])),
        }
    return {"robots": len(whole), "ways": out}


def main() -> None:
    """Fill in what is left, print the table, and keep it under benchmarks/results/."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--gaits", type=int, default=2000)
    parser.add_argument("--only", nargs="*", default=list(WAYS), choices=list(WAYS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--journal", type=Path)
    parser.add_argument("--tune", action="store_true")
    given = parser.parse_args()
    seed = TUNE if given.tune else REPORT
    plan = {"seed": seed, "gaits": given.gaits}
    path = given.journal or RESULTS / f"gait_search{'_tune' if given.tune else ''}.jsonl"
    journal = Journal(path, {"plan": plan})
    journal.begin()
    drawn, robots, refused = draws(seed), {}, 0
    for number, values in enumerate(drawn):
        if len(robots) == given.robots:
            break
        own, fair = packaged(trials_of(values, stream_seed(seed, "robot", number) % 2**31))
        if own >= ABLE and fair >= ABLE:
            robots[number] = fair
        else:
            refused += 1
    print(
        f"{len(robots)} robots; {refused} draws refused, on which no packaged gait walks {ABLE} m", flush=True
    )
    done = {(line["robot"], line["way"]): line for line in journal.lines() if "way" in line}
    cells = [
        Cell(n, drawn[n], way, given.gaits, seed)
        for n in robots
        for way in given.only
        if (n, way) not in done
    ]
    with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
        asked = {pool.submit(work, cell): cell for cell in cells}
        for future in as_completed(asked):
            cell, found = asked[future], future.result()
            done[cell.number, cell.way] = journal.add({"robot": cell.number, "way": cell.way, **found})
            print(
                f"robot {cell.number} ({robots[cell.number]:.2f} m), {cell.way}: {found['value']:.2f} m, "
                f"reached after {found['reached']}, {found['core']:.0f} s",
                flush=True,
            )
    out = {"plan": plan, "refused": refused, **table(done, robots, given.only)}
    show(out)
    if not given.tune:
        (RESULTS / "gait_search.json").write_text(json.dumps(out, indent=1) + "\n")


def show(out: dict) -> None:
    """Print the table."""
    for way, row in out["ways"].items():
        if "share" not in row:
            print(f"{way:36s} {row['m']:5.2f} m")
            continue
        good, reached, core = row["as_good"], row["reached"], row["core_to_reach"] or 0.0
        print(
            f"{way:36s} {row['m']:5.2f} m, {row['share']:4.2f} of it; as good {good['hits']}/{good['of']}; reached "
            f"{reached['hits']}/{reached['of']} after {row['gaits_to_reach']} gaits, {core:.0f} s; "
            f"{row['core']:.0f} s in all"
        )


if __name__ == "__main__":
    main()
