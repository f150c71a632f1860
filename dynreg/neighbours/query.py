"""Query: of simulators that replay a recording, the one that predicts it best: replay, synthesise, judge."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.distance.population import Population
from dynreg.distance.query import DistanceQuery
from dynreg.errors import UsageError
from dynreg.index import Graph
from dynreg.neighbours.intervals import Evidence, Interval, estimates
from dynreg.neighbours.judge import misfit
from dynreg.neighbours.retrieve import Retrieved
from dynreg.neighbours.sharpen import ROUNDS, cost, sharpen
from dynreg.neighbours.synthesise import Local, Replays, linearise, refine, replays_of
from dynreg.progress import Progress
from dynreg.replay.data import Data, data
from dynreg.replay.jitter import CANDIDATES, jitter
from dynreg.replay.judged import channel_errors
from dynreg.replay.parts import seen
from dynreg.replay.samples import samples_in_all
from dynreg.replay.timed import on_grid
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.robot import Robot

REPLAYED = 0.6  # share of the search that replays candidates; the rest synthesises
HALVED = 1  # replay with half the time step, for the intervals


@dataclass(frozen=True, eq=False)
class Case:
    """A recording that is to be replayed in simulators of a population; report : of a stage, so much done of all."""

    population: Population
    data: Data
    replayer: Replayer
    report: Progress

    @property
    def robot(self) -> Robot:
        """The population's robot."""
        return self.population.shared.robot


def case_of(
    population: Population, recording: Recording, *, hold_out: str | None, threads: int, report: Progress
) -> Case:
    """A recording cut and parted; raises as `data` does."""
    robot = population.shared.robot
    cut = data(robot, recording, hold_out)
    return Case(population, cut, Replayer(robot, cut.windows, threads), report)


def distance_query(case: Case, graph: Graph | None, at_least: int) -> DistanceQuery:
    """What a distance is asked: of the recording, the rows that are not held out."""
    cut, chosen = case.data, case.data.parts.chosen

    def replayed(unit: np.ndarray) -> np.ndarray:
        found = errors(case.replayer.residuals(cut.values_of(unit), chosen)).mean(axis=1)
        case.report("retrieve", case.replayer.rollouts, len(case.population))
        return found

    rows = seen(on_grid(case.robot, cut.recording), cut.windows, chosen)
    return DistanceQuery(case.population, rows, replayed, cut.known, at_least, graph, case.replayer.threads)


@dataclass(frozen=True)
class Spending:
    """What a query spends: the k nearest are replayed in any case, others where `replay`; `budget` replays in all.

    synthesise : whether a simulator is made of them. Raises UsageError where the budget does not suffice.
    """

    k: int
    budget: int
    replay: bool = True
    synthesise: bool = True

    def __post_init__(self) -> None:
        if self.budget < self.k + 2:
            raise UsageError(
                f"a budget of {self.budget} replays",
                expected=f"at least {self.k + 2} for k = {self.k}",
                do="raise --budget or lower -k",
            )

    def entries(self, taken: int, free: int) -> int:
        """How many entries are replayed where so many other candidates are, with so many free parameters."""
        if not self.replay:
            return self.k
        room = round(REPLAYED * self.search(free)) if self.synthesise else self.budget
        return max(self.k, room - taken)

    def search(self, free: int) -> int:
        """Replays that look for the region of the answer, with so many free parameters; the rest sharpens it."""
        return max(min(self.budget, _usual_search(free, self.k)), self.budget - ROUNDS * cost(free) - HALVED)


def usual_budget(parameters: int, k: int) -> int:
    """Most simulators that a query replays to choose its answer."""
    return _usual_search(parameters, k) + ROUNDS * cost(parameters) + HALVED


def _usual_search(parameters: int, k: int) -> int:
    """Each parameter needs two replays to be told from the others."""
    return max(18 + 2 * parameters, k + 12)


@dataclass(frozen=True)
class Candidate:
    """One simulator that was replayed: "nominal", "neighbour" (which entry) or "synthesised"."""

    kind: str
    entry: int | None = None


@dataclass(frozen=True, eq=False)
class Choice:
    """The best of what was replayed, and how it does on what was held out. Simulators are numbers of `candidates`.

    candidates : all that were replayed, the nominal first; replays : their parameters and errors. begun : how many of
    them before the synthesis. nearest : the k nearest entries. best : of the entries; made : of the synthesised, None
    where there is none; answer : of all. intervals : of the parameters of `made`.
    tests : (W_test,) errors by simulator. judged : (W',) windows that judge, the test part where there is one, in which
    nominal and answer have states (2, W', T+1, S) and errors by channel (2, S). misfit : see `judge.misfit`.
    rollouts : simulators run to choose.
    """

    candidates: tuple[Candidate, ...]
    replays: Replays
    begun: int
    nearest: tuple[int, ...]
    best: int
    made: int | None
    answer: int
    intervals: dict[str, Interval]
    tests: dict[int, np.ndarray]
    judged: np.ndarray
    states: np.ndarray
    channels: np.ndarray
    misfit: float
    rollouts: int


def choose(case: Case, found: Retrieved, spending: Spending) -> Choice:
    """Replay what was found, synthesise, choose; then replay the test part once, in all that is told of."""
    candidates, replays, local, begun = _replayed(case, found, spending)
    score = replays.score

    def best_of(*kinds: str) -> int | None:
        ids = [i for i, c in enumerate(candidates) if c.kind in kinds]
        return min(ids, key=lambda i: (score[i], i)) if ids else None

    made, noisy = best_of("synthesised"), False
    if made is not None:
        replays, noisy = _with_noise(case, replays, made)
    nearest = tuple(i for i, c in enumerate(candidates) if c.kind == "neighbour")[: spending.k]
    best, answer = best_of("neighbour"), best_of("nominal", "neighbour", "synthesised")
    told = sorted({0, *nearest, best, answer, made} - {None})
    intervals = _intervals(case, replays, local, made, answer) if made is not None else {}
    values = case.data.values_of(replays.unit)
    test = np.flatnonzero(case.data.parts.test)
    tests = errors(case.replayer.residuals(values[told], test)) if len(test) else np.zeros((len(told), 0))
    judged = test if len(test) else case.data.parts.chosen
    states = case.replayer.states(values[[0, answer]], judged)
    return Choice(
        candidates=candidates,
        replays=replays,
        begun=begun,
        nearest=nearest,
        best=best,
        made=made,
        answer=answer,
        intervals=intervals,
        tests=dict(zip(told, tests, strict=True)),
        judged=judged,
        states=states,
        channels=channel_errors(case.data.windows, states, judged),
        misfit=misfit(replays.residuals[:begun], float(replays.fit[answer])),
        rollouts=found.ranked.replays + len(replays.unit) + CANDIDATES * noisy + (local is not None),
    )


def _intervals(
    case: Case, replays: Replays, local: Local | None, made: int, answer: int
) -> dict[str, Interval]:
    """Of the parameters of what was made, of the linear model about the best or, without it, one that is regressed."""
    halved, chosen = None, case.data.parts.chosen
    if local is not None:
        finer = Replayer(case.robot.stepped(2), case.data.windows, case.replayer.threads)
        halved = finer.residuals(case.data.values_of(local.centre[None]), chosen)[:, replays.to_fit]
    evidence = Evidence(samples_in_all(replays.residuals[answer]), halved)
    return estimates(replays, local or linearise(replays), replays.unit[made], evidence, case.data.values_of)


def _replayed(
    case: Case, found: Retrieved, spending: Spending
) -> tuple[tuple[Candidate, ...], Replays, Local | None, int]:
    """Nominal, guess and nearest first (how many); then the synthesis with what is left of the budget.

    Also the linear model about the best of them, where slopes were simulated.
    """
    space, chosen = case.robot.space, case.data.parts.chosen
    first, unit = [Candidate("nominal")], [space.to_unit(space.nominal)]
    if spending.synthesise and found.guess is not None:
        first.append(Candidate("synthesised"))
        unit.append(found.guess)
    free = np.isnan(case.data.known)
    entries = found.ranked.order[: spending.entries(len(first), int(free.sum()))]
    first += [Candidate("neighbour", int(entry)) for entry in entries]
    units = case.data.with_known(np.array([*unit, *case.population.unit[entries]]))
    before = case.replayer.rollouts

    def replay(some: np.ndarray) -> np.ndarray:
        found = case.replayer.residuals(case.data.values_of(some), chosen)
        case.report("replay", case.replayer.rollouts - before, spending.budget)
        return found

    case.report("replay", 0, spending.budget)
    replays = replays_of(space, free, case.data.parts.fit[chosen], units, replay(units))
    local = None
    if spending.synthesise and free.any() and len(first) > 3:
        search = spending.search(int(free.sum()))
        replays = refine(replays, replay, search - len(first), case.population.shared.seed)
        replays, local = sharpen(replays, replay, spending.budget - len(replays.unit) - HALVED)
    case.report("replay", spending.budget, spending.budget)
    made = [Candidate("synthesised")] * (len(replays.unit) - len(first))
    return (*first, *made), replays, local, len(first)


def _with_noise(case: Case, replays: Replays, made: int) -> tuple[Replays, bool]:
    """A synthesised simulator with the motor noise that the log tells, and whether it tells it.

    Replays have none, and cannot.
    """
    space, replayer = case.robot.space, case.replayer
    values = case.data.values_of(replays.unit[made])
    noisy = jitter(
        case.robot, case.data.windows, values, None, case.data.parts.chosen, threads=replayer.threads
    )
    if noisy is values:
        return replays, False
    unit = replays.unit.copy()
    unit[made] = case.data.with_known(space.to_unit(noisy))
    return replace(replays, unit=unit), True
