"""Query: of simulators that replay a recording, the one that predicts it best: replay, synthesise, judge."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.distance.population import Population
from dynreg.distance.query import DistanceQuery, OwnModel
from dynreg.evidence.gaussian import Gaussian
from dynreg.evidence.lockstep import one_blas_thread
from dynreg.neighbours.intervals import Evidence, Interval, estimates
from dynreg.neighbours.judge import Judgement, judge
from dynreg.neighbours.make import Replaying, make
from dynreg.neighbours.retrieve import Retrieved
from dynreg.neighbours.sharpen import Made, promised
from dynreg.neighbours.spending import HALVED, Spending, Unknown
from dynreg.neighbours.synthesise import Replays, linearise, replays_of
from dynreg.progress import Progress
from dynreg.replay.data import Data, data
from dynreg.replay.jitter import jitter
from dynreg.replay.judged import channel_errors
from dynreg.replay.parts import seen
from dynreg.replay.samples import samples_in_all
from dynreg.replay.start_error import noisy_channels
from dynreg.replay.timed import on_grid
from dynreg.replay.windows import Replayer, errors
from dynreg.sim.robot import Robot

FEWEST = 3  # simulators beside the nominal one of which another may be made


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


def distance_query(
    case: Case, spending: Spending, *, exact: bool = False, own: OwnModel | None = None
) -> DistanceQuery:
    """What a distance is asked: of the recording, the rows that are not held out.

    exact : whether all entries are judged. own : gives the model of rows, where it is not to be trained.
    """
    cut, chosen = case.data, case.data.parts.chosen

    def replayed(unit: np.ndarray) -> np.ndarray:
        found = errors(case.replayer.residuals(cut.values_of(unit), chosen)).mean(axis=1)
        case.report("retrieve", case.replayer.rollouts, len(case.population))
        return found

    rows = seen(on_grid(case.robot, cut.recording), cut.windows, chosen)
    return DistanceQuery(
        case.population,
        rows,
        replayed,
        cut.known,
        at_least=spending.k,
        wanted=spending.entries(1, _unknown(case)),
        exact=exact,
        threads=case.replayer.threads,
        own=own,
    )


def _unknown(case: Case) -> Unknown:
    return Unknown(int(np.isnan(case.data.known).sum()), len(noisy_channels(case.robot)))


@dataclass(frozen=True)
class Candidate:
    """One simulator that was replayed: "nominal", "neighbour" (which entry) or "synthesised"."""

    kind: str
    entry: int | None = None


@dataclass(frozen=True, eq=False)
class Choice:
    """The best of what was replayed, and how it does on what was held out. Simulators are numbers of `candidates`.

    candidates : the nominal, what was found, and what was made of it, if anything was; replays : their parameters and
    errors. begun : how many of them before the synthesis. spent : simulators run to choose. nearest : the k nearest
    entries. best : of the entries; made : what was made, else the guess, None without either; answer : the best of
    nominal, entries and `made`, whose search begins with the guess. intervals : of the parameters of `made`;
    posterior : of the free ones, None without it. tests : (W_test,) errors by simulator. judged : (W',) windows that
    judge, the test part where there is one, in which nominal and answer have states (2, W', T+1, S) and errors by
    channel (2, S).
    judgement : whether the answer errs as those of robots of the family would. rollouts : those of
    the choice, and all that was run for the retrieval, the intervals and the motor noise; not twins of the judgement.
    """

    candidates: tuple[Candidate, ...]
    replays: Replays
    begun: int
    spent: int
    nearest: tuple[int, ...]
    best: int
    made: int | None
    answer: int
    intervals: dict[str, Interval]
    posterior: Gaussian | None
    tests: dict[int, np.ndarray]
    judged: np.ndarray
    states: np.ndarray
    channels: np.ndarray
    judgement: Judgement
    rollouts: int


@one_blas_thread()
def choose(case: Case, found: Retrieved, spending: Spending) -> Choice:
    """Replay what was found, synthesise, choose; then replay the test part once, in all that is told of."""
    before = case.replayer.rollouts
    candidates, replays, synthesis = _replayed(case, found, spending)
    begun = len(candidates) - (synthesis is not None)
    spent, score = case.replayer.rollouts - before, replays.score

    def best_of(*kinds: str) -> int | None:
        ids = [i for i, c in enumerate(candidates) if c.kind in kinds]
        return min(ids, key=lambda i: (score[i], i)) if ids else None

    made, jittered = best_of("synthesised") if synthesis is None else begun, 0
    if made is not None:
        replays, jittered = _with_noise(case, replays, made)
    nearest = tuple(i for i, c in enumerate(candidates) if c.kind == "neighbour")[: spending.k]
    best, answer = best_of("neighbour"), best_of("nominal", "neighbour")
    if made is not None and score[made] <= score[answer]:
        answer = made
    told = sorted({0, *nearest, best, answer, made} - {None})
    intervals, posterior = ({}, None) if made is None else _estimates(case, replays, synthesis, made)
    values = case.data.values_of(replays.unit)
    test = np.flatnonzero(case.data.parts.test)
    tests = errors(case.replayer.residuals(values[told], test)) if len(test) else np.zeros((len(told), 0))
    judged = test if len(test) else case.data.parts.chosen
    states = case.replayer.states(values[[0, answer]], judged)
    sloped = synthesis is not None and synthesis.local is not None
    ended = promised(synthesis.local, replays.free) if sloped else None
    judgement = _judgement(case, replays, answer, ended)
    return Choice(
        candidates=candidates,
        replays=replays,
        begun=begun,
        spent=spent,
        nearest=nearest,
        best=best,
        made=made,
        answer=answer,
        intervals=intervals,
        posterior=posterior,
        tests=dict(zip(told, tests, strict=True)),
        judged=judged,
        states=states,
        channels=channel_errors(case.data.windows, states, judged),
        judgement=judgement,
        rollouts=found.ranked.replays + spent + jittered + HALVED * sloped,
    )


def _judgement(case: Case, replays: Replays, answer: int, ended: float | None) -> Judgement:
    """Of the answer beside its twins, over all windows; ended : see `sharpen.promised`, None without a search."""
    values = case.data.values_of(replays.unit[[answer]])
    every = np.arange(len(case.data.windows))
    return judge(case.replayer, values, every, case.population.shared.seed, promised=ended)


def _estimates(
    case: Case, replays: Replays, synthesis: Made | None, made: int
) -> tuple[dict[str, Interval], Gaussian]:
    """Intervals and posterior of the parameters of what was made.

    By the linear model about it or, without it, one that is regressed.
    """
    unit, values_of = replays.unit[made], case.data.values_of
    if synthesis is None or synthesis.local is None:
        return regressed(replays if synthesis is None else synthesis.replays, unit, values_of)
    finer = Replayer(case.robot.stepped(2), case.data.windows, case.replayer.threads)
    chosen, centre = case.data.parts.chosen, synthesis.local.centre[None]
    halved = finer.residuals(values_of(centre), chosen, synthesis.initial)
    mine, halved = synthesis.replays.residuals[synthesis.best], synthesis.start.removed(halved)
    effective = samples_in_all(mine) - synthesis.start.fitted[replays.to_fit].sum()
    evidence = Evidence(max(effective, 1.0), halved[:, replays.to_fit])
    return estimates(synthesis.replays, synthesis.local, unit, evidence, values_of)


def _replayed(
    case: Case, found: Retrieved, spending: Spending
) -> tuple[tuple[Candidate, ...], Replays, Made | None]:
    """Nominal, guess and nearest; last what is made of them with what is left of the budget, if anything is."""
    space, chosen = case.robot.space, case.data.parts.chosen
    first, unit = [Candidate("nominal")], [space.to_unit(space.nominal)]
    if spending.synthesise and found.guess is not None:
        first.append(Candidate("synthesised"))
        unit.append(found.guess)
    free = np.isnan(case.data.known)
    unknown = _unknown(case)
    entries = found.ranked.order[: spending.entries(len(first), unknown)]
    first += [Candidate("neighbour", int(entry)) for entry in entries]
    units = case.data.with_known(np.array([*unit, *case.population.unit[entries]]))
    before = case.replayer.rollouts

    def report() -> None:
        case.report("replay", case.replayer.rollouts - before, spending.budget)

    replaying = Replaying(
        case.replayer, chosen, case.data.values_of, report, believed=not spending.starts(unknown)
    )
    report()
    residuals = replaying.residuals(units)
    replays, made = replays_of(space, free, case.data.parts.fit[chosen], units, residuals), None
    if spending.synthesise and free.any() and len(first) > FEWEST:
        spend = spending.to_make(len(first), unknown)
        made = make(replays, residuals, replaying, spend, case.population.shared.seed)
        replays = replays.grown(made.replays.unit[[made.best]], made.residual[None])
    case.report("replay", spending.budget, spending.budget)
    last = [] if made is None else [Candidate("synthesised")]
    return (*first, *last), replays, made


def _with_noise(case: Case, replays: Replays, made: int) -> tuple[Replays, int]:
    """A synthesised simulator with the motor noise that the log tells, and how many simulators were run for it.

    Replays have none, and cannot.
    """
    space, replayer = case.robot.space, case.replayer
    values = case.data.values_of(replays.unit[made])
    noisy, ran = jitter(
        case.robot, case.data.windows, values, None, case.data.parts.chosen, threads=replayer.threads
    )
    if noisy is values:
        return replays, ran
    unit = replays.unit.copy()
    unit[made] = case.data.with_known(space.to_unit(noisy))
    return replace(replays, unit=unit), ran


def regressed(
    replays: Replays, unit: np.ndarray, values_of: Callable[[np.ndarray], np.ndarray]
) -> tuple[dict[str, Interval], Gaussian]:
    """Intervals and posterior of parameters about `unit` (P,), by the linear model that is regressed on replays."""
    evidence = Evidence(samples_in_all(replays.residuals[int(replays.score.argmin())]))
    return estimates(replays, linearise(replays), unit, evidence, values_of)
