"""Which simulators a gait shall be sought in: ways to make them of one log, on hidden quadrupeds of the family.

A way is a source (`gait_sources`), what counts of its simulators (the minimum, the lower quartile or the mean), and its
rollouts: as many as any other way has, in all. So five simulators get a fifth of the gaits that one gets; draws of the
posterior take turns, and get a quarter. `gaits` : one simulator with as many gaits as these draws. `packaged` : the
search is told the robot's own gaits. Each search has a seed of its own, other motor noise and other draws. Its gait is
tried three times on the robot, as in `bench_gait_hidden`: it walks where it does not fall and goes 0.3 m or more, on
average.

What differs is paired robot by robot, by the means over searches: with its 90 % bootstrap interval, and p of Wilcoxon's
signed ranks by Holm's method over all ways. Every finished cell is a line of the journal (`--journal`); a second start
goes on. Robots that are reported were never used in development (`REPORT`).
"""

import argparse
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from bootstrap import interval
from gait_jobs import Cells, Job, Plan, run, search_seed
from gait_sources import LOGS, SEARCHES, logged, simulators
from gait_tried import searched
from kept import RESULTS, keep
from scipy.stats import wilcoxon
from walkers import FAMILY, RATE, TUNE, Walker, walker_of

import dynreg
from dynreg.gait.accept import USUAL
from dynreg.gait.seek import AGAIN, SearchSettings
from dynreg.gait.tasks import task_of
from dynreg.gait.trials import Trials
from dynreg.sim.real import Budget, Spent
from dynreg.sim.robot import load_robot
from dynreg.timed.compare import holm
from dynreg.verbs.gait import DOUBT, MEAN, MEETS, ROLLOUTS

REPORT = 20270112
ROBOTS = 12
ONE = "synthesised"
DEFAULT = "posterior"  # against which the others are held
SEVERAL = ("nearest", "noisy", "pulled")


@dataclass(frozen=True)
class Way:
    """Where a gait is sought.

    as_drawn : whether it has no more gaits than draws that take turns have. packaged : whether the search is told the
    robot's own gaits.
    """

    source: str
    accept: str = USUAL
    as_drawn: bool = False
    packaged: bool = False


WAYS = {
    DEFAULT: Way(DEFAULT, MEAN),
    f"{DEFAULT} packaged": Way(DEFAULT, MEAN, packaged=True),
    f"{DEFAULT} quartile": Way(DEFAULT, "quantile"),
    f"{DEFAULT} min": Way(DEFAULT),
    ONE: Way(ONE),
    f"{ONE} gaits": Way(ONE, as_drawn=True),
    f"{ONE} packaged": Way(ONE, packaged=True),
    "hand": Way("hand"),
    **{source: Way(source) for source in SEVERAL},
    **{f"{source} mean": Way(source, MEAN) for source in SEVERAL},
}


# What the page shows; the other ways are there to be asked for.
TABLE = tuple(way for way in WAYS if way != f"{ONE} packaged" and not way.endswith(" mean"))


def step_of(way: str, number: int) -> str:
    """The step of a way's search of this number, from 0."""
    return f"{way}, search {number + 1}"


def work(job: Job) -> str:
    """All that is left of one robot, on one core; its name."""
    walker = walker_of(job.name, job.plan.seed)
    journal = Cells(job.journal, job.plan)
    for step in job.sources:
        way, _, number = step.rpartition(", search ")
        source = WAYS[way].source
        told = logged(job, walker, journal, (source,))[LOGS[source]]
        journal.timed(walker.name, step, partial(cell, job, walker, WAYS[way], int(number) - 1, told))
    return walker.name


def cell(job: Job, walker: Walker, way: Way, number: int, step: dict) -> dict:
    """The gait that one search finds in a way's simulators, tried on the robot."""
    made, seed = simulators(job, walker, way.source, step, number), search_seed(walker.seed, number)
    noise = seed if number else walker.seed  # the first search is as those of the other table
    trials = Trials(walker.robot, task_of(walker.robot), made, rate=RATE, seed=noise, threads=1)
    rollouts = job.plan.rollouts // (MEETS if way.as_drawn else 1)
    turns = {"meets": MEETS, "doubt": DOUBT} if way.source == "posterior" else {}
    settings = SearchSettings("cma", way.accept, rollouts, seed, again=AGAIN, packaged=way.packaged, **turns)
    spent = Spent(**step["spent"])
    found = searched(walker, trials, walker.real(Budget(), spent), settings)
    return {**found, "simulators": len(made), "spent": asdict(spent)}


def table(steps: dict[tuple[str, str], dict], seconds: float) -> dict[str, dict]:
    """{way: figures} of all finished searches; `seconds` of a trial."""
    cells: dict[str, dict[str, list[dict]]] = {}
    for (robot, step), found in steps.items():
        way, _, number = step.rpartition(", search ")
        if number:
            cells.setdefault(way, {}).setdefault(robot, []).append(found)
    rows = {way: _row(cells[way], seconds) for way in WAYS if way in cells}
    if DEFAULT in rows:
        speed = {way: rows[way]["speeds"] for way in rows}
        apart = {way: _apart(speed[way], speed[DEFAULT]) for way in rows if way != DEFAULT}
        tested = [way for way, differences in apart.items() if len(differences)]
        p = holm([float(wilcoxon(apart[w]).pvalue) if apart[w].any() else 1.0 for w in tested])
        for way, chance in zip(tested, p, strict=True):
            rows[way]["difference"] = interval(apart[way])
            rows[way] |= {"pairs": len(apart[way]), "p": chance}
    return rows


def _row(cells: dict[str, list[dict]], seconds: float) -> dict:
    every = [c for own in cells.values() for c in own]
    speeds = {
        robot: float(np.mean([100.0 * c["real"] / seconds for c in own])) for robot, own in cells.items()
    }
    return {
        "robots": len(cells),
        "searches": len(every),
        "walks": sum(c["success"] for c in every),
        "share": interval(np.array([np.mean([c["success"] for c in own]) for own in cells.values()])),
        "speed": interval(np.array([*speeds.values()])),
        "speeds": speeds,
        "falls": sum(c["fell"] for c in every),
        "gaits": float(np.mean([c["gaits"] for c in every])),
        "core": float(np.mean([c["core"] for c in every])),
    }


def _apart(mine: dict[str, float], others: dict[str, float]) -> np.ndarray:
    """(n,) differences on the robots that both have."""
    return np.array([mine[robot] - others[robot] for robot in mine if robot in others])


def show(rows: dict[str, dict]) -> None:
    """Print the table."""
    print(
        f"{'':18s} robots   walks  falls  speed [cm/s]           gaits  core s  less {DEFAULT}'s [cm/s], p (Holm)"
    )
    for way, row in rows.items():
        won = f"{row['walks']}/{row['searches']}"
        behind = f"{_told(row['difference'])}  {row['p']:.3f}" if "p" in row else ""
        print(
            f"{way:18s} {row['robots']:6d} {won:>7s}  {row['falls']:5d}  {_told(row['speed'])}  {row['gaits']:6.0f}"
            f"  {row['core']:6.0f}  {behind}".rstrip()
        )


def _told(found: list[float]) -> str:
    value, low, high = found
    return f"{value:6.2f} [{low:6.2f}, {high:6.2f}]"


def main() -> None:
    """Fill in what is left of the table, print it, and keep it under benchmarks/results/."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="*", choices=WAYS, default=TABLE, help="these ways alone")
    parser.add_argument("--searches", type=int, default=1, help="of each way")
    parser.add_argument("--robots", type=int, default=ROBOTS, help="the first ones")
    parser.add_argument("--rollouts", type=int, default=ROLLOUTS)
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument("--registry", default="benchmarks/registry")
    parser.add_argument("--journal", type=Path, default=RESULTS / "gait_ways.jsonl")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no table")
    given = parser.parse_args()
    if given.searches > SEARCHES:
        parser.error(f"--searches {given.searches}: of each robot there are draws for {SEARCHES} searches")
    plan = Plan(TUNE if given.tune else REPORT, ROBOTS, given.rollouts, given.entries)
    journal = Cells(given.journal, plan)
    journal.begin()
    with dynreg.open(given.registry) as reg:
        population = reg.populate("quadruped", given.entries, threads=given.processes).population
    done, jobs = journal.steps(), []
    steps = [step_of(way, number) for number in range(given.searches) for way in given.only]
    for name in (f"{FAMILY} {i}" for i in range(given.robots)):
        left = tuple(step for step in steps if (name, step) not in done)
        if left:
            jobs.append(Job(plan, name, left, given.journal, given.registry, population))
    print(f"{sum(len(j.sources) for j in jobs)} searches on {len(jobs)} robots are left", flush=True)
    run(work, jobs, given.processes)
    rows = table(journal.steps(), task_of(load_robot("quadruped")).seconds)
    show(rows)
    ratios = [found["truth"] for (_, step), found in journal.steps().items() if step == "query"]
    if ratios:
        print(f"true simulators err {min(ratios):.2f} to {max(ratios):.2f} times as much as the answers")
    keep(RESULTS / "gait_ways.json", {"plan": asdict(plan), "ways": rows}, parser, given)


if __name__ == "__main__":
    main()
