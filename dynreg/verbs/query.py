"""Query: the simulator that predicts a recording best. Retrieve, replay and re-rank, synthesise."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.distance.table import AUTO, NAMES, needs
from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, hold_out, option, threads

if TYPE_CHECKING:
    from dynreg.distance.population import Population
    from dynreg.results.causes import Causes
    from dynreg.results.neighbours import Neighbours
    from dynreg.verbs.neighbours import Subject
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class QuerySettings(Settings):
    """The settings of `query`."""

    k: int = option(5, "Number of neighbours.", flag="-k", least=1, shared=True)
    distance: str = option(AUTO, "Distance by which neighbours are found.", choices=NAMES, shared=True)
    population: str | None = option(
        None, "Population in which to search.", usual="the only one", complete="stored_names"
    )
    replay: bool = option(
        True, "Replay the commands in the nearest simulators and rank them by replay error."
    )
    synthesise: bool = option(True, "Make a new simulator from the neighbours.")
    exact: bool = option(
        False,
        "Judge every simulator of the population, rather than those alone that are foreseen to be near.",
    )
    hold_out: str | None = hold_out()
    budget: int | None = option(
        None,
        "Most simulations of the query; those of --distance replay come on top.",
        usual="69 + 26 for each parameter + 3 for each channel with noise; without noise 59 + 22 for each parameter",
        least=1,
        shared=True,
    )
    threads: int = threads()

    @property
    def states(self) -> bool:
        """Whether the population must be loaded with the entries' states."""
        return needs(self.distance, "states")

    @property
    def judged(self) -> bool:
        """Whether the population must be loaded with the rows that judge its entries."""
        return needs(self.distance, "judged")


def query(
    asked: "Recorded",
    settings: QuerySettings,
    progress: Progress | None = None,
    *,
    population: "Population | None" = None,
) -> "Neighbours | Causes":
    """Find the simulators nearest to a recording.

    The query replays the recording's commands in them and ranks them by the replay error. It synthesises a simulator
    from the best ones. The answer is the simulator with the lowest error.

    The recording's own model is registered as an entry of the population, by which later recordings find it.

    On a population of effects (`dynreg populate --effects --like RECORDING`) it shows which causes the recording looks
    like instead.

    The headline says so where held-out data do not show that the answer beats the nominal simulator, where they are too
    few, or where the search had not ended.

    Exit status 4: no simulator of the population fits: the answer errs more than simulated robots with noise would. The
    result is printed nevertheless.

    Example: dynreg query monday -k 5 --hold-out kp=400 --report monday.html

    Raises UsageError where k or the budget cannot be met, LogError where the
    recording cannot be replayed.
    """
    from dynreg.neighbours.query import choose
    from dynreg.verbs.causes import looks_like
    from dynreg.verbs.neighbours import judged, unjudged
    from dynreg.verbs.subjects import named_effects

    if population is None and (effects := named_effects(asked, settings.population)) is not None:
        return looks_like(asked, effects, settings, progress)
    subject = retrieved(asked, settings, progress, population=population)
    if not settings.replay and not settings.synthesise:
        return unjudged(subject)
    return judged(subject, choose(subject.case, subject.found, subject.spending))


def retrieved(
    asked: "Recorded",
    settings: QuerySettings,
    progress: Progress | None = None,
    *,
    population: "Population | None" = None,
) -> "Subject":
    """What a query finds before it replays and synthesises; the recording's own model is registered.

    Raises as `query`.
    """
    from dynreg.neighbours.query import case_of, distance_query
    from dynreg.neighbours.retrieve import retrieve
    from dynreg.neighbours.spending import Spending, usual_budget
    from dynreg.verbs.measured import kept_model, near_measured, register_measured
    from dynreg.verbs.neighbours import Subject
    from dynreg.verbs.populations import ready

    began, k, recording = time.perf_counter(), settings.k, asked.recording
    if population is None:
        population = ready(asked, settings.population, states=settings.states, judged=settings.judged)
    if k > len(population):
        raise UsageError(
            f"k = {k}",
            expected=f"1 to {len(population)}, the simulators of the population",
            do="ask for fewer neighbours, or populate more simulators",
        )
    budget = settings.budget or usual_budget(population.shared.robot, k)
    spending = Spending(k, budget, settings.replay, settings.synthesise)
    report = progress or (lambda *_: None)
    case = case_of(population, recording, hold_out=settings.hold_out, threads=settings.threads, report=report)
    report("retrieve", 0, 1)
    own = kept_model(asked.registry, population.id)
    rows = distance_query(case, spending, exact=settings.exact, own=own)
    found = retrieve(rows, settings.distance, guess=settings.synthesise)
    report("retrieve", 1, 1)
    measured = near_measured(asked, rows, found.distance_name, k)
    register_measured(asked, population, threads=settings.threads)
    return Subject(asked, case, found, measured, spending, began)
