"""The document of a gait, made from the result of its search."""

from dataclasses import asdict, dataclass

import numpy as np

from dynreg.gait.accept import ACCEPT
from dynreg.gait.play import joints
from dynreg.gait.seek import Finals, Simulated, Sought
from dynreg.gait.table import JointTable
from dynreg.gait.tasks import fell, fitness
from dynreg.gait.trials import Trials
from dynreg.gait.ways import ways
from dynreg.results.gait import OFTEN, Fitness, Gait, GaitExpected, GaitGene, GaitStep, GaitTable, GaitTrial
from dynreg.results.result import Cost
from dynreg.results.trials import rate
from dynreg.verbs.gait_searches import Searched
from dynreg.verbs.gait_simulators import Chosen


@dataclass(frozen=True)
class HowFound:
    """How a gait was found: the fields of its document that tell it, by their names there."""

    recording: str | None
    recording_name: str
    method: str
    seed: int
    ended: str
    evaluations: int
    notes: tuple[str, ...]
    history: tuple[GaitStep, ...] = ()
    resumed: int = 0
    packaged: int | None = None


def document(
    recording: tuple[str | None, str],
    chosen: Chosen,
    trials: Trials,
    best: Searched,
    unseen: np.ndarray,
    seconds: float,
) -> Gait:
    """The document of a gait that a search found.

    recording : id and name of that for which it was sought. unseen, seconds : see `described`.
    """
    search, sought = best.search, best.sought
    found = sought.found
    how = HowFound(
        *recording,
        method=search.method,
        seed=search.seed,
        ended=found.ended,
        evaluations=found.evaluations,
        notes=(*best.notes, *_notes(sought, search.accept)),
        history=tuple(GaitStep(evaluations=n, value=v) for n, v in found.history),
        resumed=found.resumed,
        packaged=None if sought.packaged is None else sought.packaged + 1,
    )
    return described(chosen, trials, sought, unseen, seconds, search.accept, how, sought.finals)


def described(
    chosen: Chosen,
    trials: Trials,
    simulated: Simulated,
    unseen: np.ndarray,
    seconds: float,
    accept: str,
    how: HowFound,
    finals: Finals | None = None,
) -> Gait:
    """The document of a gait: what it is, how it was found, and what it does in simulators.

    unseen : (n,) its grades in runs that no choice has seen. seconds : wall time. accept : statistic over the
    simulators that is its value. finals : the runs that chose it.
    """
    robot = trials.robot
    task, space = trials.task, trials.space
    values = {name: float(of(simulated.fitness[None])[0]) for name, of in ACCEPT.items()}
    runs = len(simulated.fell) + (finals.runs if finals else 0)
    falls = int(simulated.fell.sum()) + (finals.falls if finals else 0)
    stood = falls <= (0 if accept == "min" else OFTEN * runs)
    return Gait(
        robot=robot.name,
        robot_hash=robot.hash,
        on=chosen.on,
        k=len(trials.simulators),
        source=chosen.source,
        task=task.name,
        unit=task.unit,
        success=task.success,
        seconds=task.seconds,
        rate=trials.rate,
        ramp=space.ramp,
        kind=space.kind,
        genes={
            g.name: GaitGene(value=float(v), low=g.low, high=g.high, unit=g.unit)
            for g, v in zip(space.genes, simulated.genes, strict=True)
        },
        joints=joints(space),
        table=_table(space.table(simulated.genes)),
        accept=accept,
        value=values[accept],
        fitness=Fitness(**values),
        expected=_expected(unseen),
        succeeded=bool(stood and values[accept] >= task.success),
        finals=finals,
        trials=_trials(chosen, trials, simulated),
        cost=Cost(evaluations=0, rollouts=trials.rollouts, seconds=seconds),
        **vars(how),
    )


def _table(table: JointTable) -> GaitTable:
    return GaitTable(period=table.period, times=table.times.tolist(), targets=table.targets.tolist())


def _trials(chosen: Chosen, trials: Trials, simulated: Simulated) -> tuple[GaitTrial, ...]:
    as_dict = trials.robot.space.as_dict
    each = zip(
        chosen.simulators, chosen.kinds, trials.simulators.values, ways(simulated, trials.rate), strict=True
    )
    return tuple(
        GaitTrial(simulator=one.id, kind=kind, parameters=as_dict(values), **asdict(way))
        for one, kind, values, way in each
    )


def _expected(grades: np.ndarray) -> GaitExpected:
    """Of the grades (n,) of runs that no choice has seen."""
    falls, (low, median, high) = rate(fell(grades)), np.quantile(fitness(grades), [0.05, 0.5, 0.95])
    return GaitExpected(
        runs=falls.of,
        falls=falls.hits,
        low=falls.low,
        high=falls.high,
        median=float(median),
        p5=float(low),
        p95=float(high),
    )


def _notes(sought: Sought, accept: str) -> tuple[str, ...]:
    """On a gait that the search only chose, and on the simulators in which every gait that was tried there fell."""
    notes, helpless = [], sought.helpless
    if sought.packaged is not None:
        number = f"number {sought.packaged + 1} of the gaits in the robot's folder"
        better = "no other gait of this search was better, and more --rollouts may find one"
        notes.append(f"this gait is {number}, unchanged: {better}")
    if helpless.any():
        many = f"{helpless.sum()} of {len(helpless)} simulators"
        notes.append(f"every gait that was tried there fell in {many}: a fall counts as 0 in the {accept}")
    return tuple(notes)
