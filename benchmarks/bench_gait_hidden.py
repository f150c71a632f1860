"""Gaits for hidden quadrupeds, by the simulators that they were sought in: who walks, and how fast.

24 robots (`walkers`): 12 in the family, 12 with an effect that it lacks. A gait is sought with the same rollouts in
each of `SOURCES`, as many as the search of `dynreg gait` tries gaits. It is then tried three times on the robot through
`RealRobot`. Success: no fall in these, and 0.3 m or more in 10 s, on average. Speed is the task's mean fitness over its
time (0 for a fall), as a share of the oracle's the ratio of the means. No search is told the packaged gaits but with
`--packaged`. Real trials and seconds are what a source needs before its gait is judged. Intervals are of 90 %:
bootstrap over robots, of counts Clopper-Pearson's.

`packaged` : the best of the robot's own gaits, by a trial of each. `hill` : the paper's hill climber on the nearest.
`pulled` : the query's answer and its neighbours, each moved most of the way to it. `rounds` : `dynreg gait --trial`,
three trials, the best gait of these; `first` : what `dynreg gait` finds without them; `luckiest` : of the three gaits
the one that reached most in its one trial. Each search of these three has the rollouts of the command, which try as
many gaits as the other sources do. `true` : the oracle, the middle one of five searches by what their gaits do on the
robot. `calibrated` : the diagnosis without its causes: what it gains over that, the causes gain, and not the nameplate
that only the diagnosis reads. What a cause needs is found from robots of the development that hide nothing (`--nulls`).

Every finished cell is a line of the journal (`--journal`); a second start goes on. Robots that are reported were
never used in development (`REPORT`), but seven of `--seed 20261227`, on which the draws of `dynreg gait` were
tuned later.
"""

import argparse
import hashlib
import json
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from gait_hidden_table import SOURCES, show, table
from gait_jobs import ORACLES, TRIALS, Cells, Job, K, Plan, run, search_seed
from gait_sources import LOGS, logged, simulators
from gait_tried import searched, tried
from kept import RESULTS, keep
from walkers import FAMILY, NULL, RATE, TUNE, Walker, excited, named, names, stood_and_trotted, walker_of

import dynreg
from dynreg.diagnose.threshold import USUAL, level
from dynreg.errors import DynregError, NoMatchError
from dynreg.gait.play import commands
from dynreg.gait.seek import AGAIN, SearchSettings
from dynreg.gait.tasks import fitness, task_of
from dynreg.gait.trials import Trials
from dynreg.results.gait import Gait
from dynreg.sim.real import Budget, SimulatedRobot, Spent
from dynreg.sim.robot import load_robot
from dynreg.verbs.gait import MEETS, ROLLOUTS
from dynreg.verbs.gait_rounds import GaitRoundsSettings, gait_rounds
from dynreg.verbs.subjects import Recorded

REPORT = 20270111
GAITS = ROLLOUTS // MEETS  # about as many gaits as a search of `dynreg gait` tries
FILE = RESULTS / "gait_hidden.json"


def work(job: Job) -> str:
    """All that is left of one robot, on one core; its name."""
    walker = walker_of(job.name, job.plan.seed)
    journal = Cells(job.journal, job.plan)
    steps = journal.steps()
    left = tuple(source for source in job.sources if (walker.name, source) not in steps)
    done = logged(job, walker, journal, left)
    for source in left:
        made = partial(_cell, job, walker, source, done.get(LOGS.get(source, "")))
        journal.timed(walker.name, source, made)
    return walker.name


def null(job: Job) -> str:
    """The score that the best cause reaches on a robot of the development that hides nothing; its name."""
    walker = walker_of(job.name, TUNE)
    Cells(job.journal, job.plan).timed(job.name, NULL, partial(_chance, job, walker))
    return job.name


def _chance(job: Job, walker: Walker) -> dict:
    try:
        log, _ = stood_and_trotted(walker)
        return {"nats": named(walker, log, np.inf, job.plan.effects).nats[0]}
    except DynregError:  # it fell too often: no diagnosis, no alarm
        return {"nats": 0.0}


def _cell(job: Job, walker: Walker, source: str, step: dict | None) -> dict:
    """A gait sought in the simulators of a source, and tried on the robot."""
    before = Spent(**step["spent"]) if step else Spent()
    if step and "problem" in step:
        return {"real": 0.0, "fell": False, "success": False, "spent": asdict(before), **_none(step)}
    real = walker.real(Budget(), before)
    if source == "rounds":
        return _rounds(job, walker, real)
    task = walker.task if source == "true" else task_of(walker.robot)
    trials = Trials(
        walker.robot, task, simulators(job, walker, source, step), rate=RATE, seed=walker.seed, threads=1
    )
    if source == "packaged":
        return _packaged(walker, real, trials)
    many = ORACLES if source == "true" else 1
    found = sorted(
        (searched(walker, trials, real, _settings(job, walker, source, i)) for i in range(many)),
        key=lambda c: c["real"],
    )
    return found[many // 2] | {"spent": asdict(before), "all": [c["real"] for c in found]}


def _settings(job: Job, walker: Walker, source: str, number: int) -> SearchSettings:
    method, accept = ("hill" if source == "hill" else "cma"), ("mean" if source == "population" else "min")
    return SearchSettings(
        method,
        accept,
        job.plan.rollouts,
        search_seed(walker.seed, number),
        again=0.0 if source == "hill" else AGAIN,
        packaged=job.plan.packaged,
    )


def _packaged(walker: Walker, real: SimulatedRobot, trials: Trials) -> dict:
    """The best of the robot's own gaits by one trial of each, then tried as the others are."""
    space, task = trials.space, task_of(walker.robot)
    gaits = space.targets(space.feasible(space.from_unit(space.starts)), trials.times)
    once = [fitness(task.grade(real.run(a, RATE, f"own_{i}").walk))[0, 0] for i, a in enumerate(gaits)]
    best, spent = int(np.argmax(once)), asdict(real.spent)
    return {**tried(walker, real, gaits[best]), "number": best + 1, "spent": spent}


def _rounds(job: Job, walker: Walker, real: SimulatedRobot) -> dict:
    """The best gait of trials in turn; `first`: what that of the first search does, without more trials."""
    log, _ = excited(walker)
    settings = GaitRoundsSettings(
        k=K,
        rollouts=None if job.plan.rollouts == GAITS else job.plan.rollouts * MEETS,
        packaged=job.plan.packaged,
        population=job.population,
        seed=search_seed(walker.seed),
        threads=1,
        trials=TRIALS,
    )
    before = real.spent
    with dynreg.open(job.registry, create=False) as reg:
        asked = Recorded(reg.registry, walker.robot, log, f"{job.plan.seed} {walker.name}")
        asked.register()
        try:
            found = gait_rounds(asked, settings, real)
        except NoMatchError as problem:  # no simulator is close enough
            return {
                "real": 0.0,
                "fell": 0,
                "success": False,
                "spent": asdict(real.spent),
                "first": {"spent": asdict(before)},
                "problem": str(problem),
            }
        documents = [Gait.model_validate(reg.registry.result(one.gait).document) for one in found.rounds]
    spent, there = real.spent, []
    for document in documents:
        real.spent = spent  # the same disturbances for all
        there.append(tried(walker, real, commands(document)[1]))
    rounds = [
        {"real": one.fitness, "fell": one.fell, "fits": one.fits, "again": one.again, "tried": again}
        for one, again in zip(found.rounds, there, strict=True)
    ]
    best = found.best or len(documents)
    first = {**there[0], "spent": asdict(before)}
    return {**there[best - 1], "best": best, "first": first, "rounds": rounds, "spent": asdict(spent)}


def _none(step: dict) -> dict:
    return {"simulated": None, "problem": step["problem"]}


def main() -> None:
    """Fill in what is left of the table, print it, and keep it under benchmarks/results/."""
    parser = _parser()
    given = parser.parse_args()
    if given.seed == TUNE or (given.tune and given.seed != REPORT):
        parser.error(f"--seed {given.seed}: robots of the development have the seed {TUNE}; say --tune alone")
    seed = TUNE if given.tune else given.seed
    plan = Plan(
        seed, given.robots, given.rollouts, given.entries, given.nulls, tuple(given.effects), given.packaged
    )
    digest = hashlib.sha256(json.dumps(asdict(plan)).encode()).hexdigest()[:8]
    ending = f"_tune_{digest}" if given.tune else "_packaged" if given.packaged else ""
    ending += f"_{given.only_kind}" if given.only_kind else ""
    ending += f"_{given.rollouts}" if given.rollouts != GAITS else ""
    ending += f"_{seed}" if seed not in (TUNE, REPORT) else ""
    path = given.journal or RESULTS / f"gait_hidden{ending}.jsonl"
    journal = Cells(path, plan)
    journal.begin()
    with dynreg.open(given.registry) as reg:
        population = reg.populate("quadruped", given.entries, threads=given.processes).population
    place = (path, given.registry, population)
    if {"diagnosed", "calibrated"} & {*given.only}:
        nulls = [Job(plan, f"{NULL} {i}", (), *place) for i in range(plan.nulls)]
        done = journal.steps()
        run(null, [j for j in nulls if (j.name, NULL) not in done], given.processes)
    done, jobs = journal.steps(), []
    scores = [found["nats"] for (_, step), found in done.items() if step == NULL]
    needed = level(scores) if scores else USUAL
    print(f"a cause needs {needed:.1f} nats, by {len(scores)} robots that hide nothing")
    halves = {"family": (True,), "outside": (False,), None: (True, False)}[given.only_kind]
    for name in [n for n in names(given.robots) if n.startswith(FAMILY) in halves]:
        left = tuple(s for s in SOURCES if s in given.only and (name, s) not in done)
        if left:
            jobs.append(Job(plan, name, left, *place, needed))
    print(f"{sum(len(j.sources) for j in jobs)} cells of {len(jobs)} robots are left", flush=True)
    run(work, jobs, given.processes)
    out = table(journal.steps(), names(given.robots), task_of(load_robot("quadruped")).seconds)
    show(out)
    if given.tune or given.journal:  # another journal need not hold all that the kept table shows
        print("no table is kept of robots of the development, nor by a journal of your own")
        return
    named = ("only", "only_kind", "rollouts", "seed", "packaged")
    keep(FILE.with_stem(FILE.stem + ending), {"plan": asdict(plan), "halves": out}, parser, given, named)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=12, help="in each half")
    parser.add_argument("--only", nargs="*", choices=SOURCES, default=SOURCES, help="these sources alone")
    parser.add_argument("--rollouts", type=int, default=GAITS, help="gaits of the default's search")
    parser.add_argument("--entries", type=int, default=1000)
    parser.add_argument(
        "--nulls", type=int, default=6, help="robots from which the diagnosis' threshold is found"
    )
    parser.add_argument("--effects", nargs="*", default=[], help="that a diagnosis may name [all]")
    parser.add_argument("--packaged", action="store_true", help="searches also try the robot's own gaits")
    parser.add_argument("--only-kind", choices=("family", "outside"), help="robots of one half alone")
    parser.add_argument("--seed", type=int, default=REPORT, help="by which other robots are drawn")
    parser.add_argument("--registry", default="benchmarks/registry")
    parser.add_argument("--journal", type=Path, help="[in benchmarks/results, by half and seed]")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tune", action="store_true", help="the robots of the development; writes no table")
    return parser


if __name__ == "__main__":
    main()
