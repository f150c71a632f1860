"""Query: from a recording to the simulator that predicts it best. Retrieve, replay and re-rank, synthesise."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.distance.table import AUTO, NAMES, needs
from dynreg.errors import UsageError
from dynreg.verbs.settings import Settings, hold_out, option, threads
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    from dynreg.distance.population import Population
    from dynreg.results.neighbours import Neighbours
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class QuerySettings(Settings):
    """What `query` can be told."""

    k: int = option(5, "How many neighbours.", flag="-k", least=1, shared=True)
    distance: str = option(AUTO, "How neighbours are found.", choices=NAMES, shared=True)
    population: str | None = option(
        None, "Population to choose from.", usual="the only one", complete="stored_names"
    )
    replay: bool = option(True, "Replay the commands in the best and re-rank.")
    synthesise: bool = option(True, "Make a simulator from the neighbours.")
    hold_out: str | None = hold_out()
    budget: int | None = option(
        None,
        "Simulations that the query may run, beyond those of --distance replay.",
        usual="18 and two for each parameter",
        least=1,
        shared=True,
    )
    threads: int = threads()

    @property
    def states(self) -> bool:
        """Whether its population must be loaded with the entries' states."""
        return needs(self.distance, "states")


def query(
    asked: "Recorded",
    settings: QuerySettings,
    progress: Progress | None = None,
    *,
    population: "Population | None" = None,
) -> "Neighbours":
    """Find the simulators nearest to a recording.

    They are replayed with the recording's own commands and ranked again, and one answer is given.

    Exit status 4 when no simulator of the population fits the recording (the result is printed all the
    same).

    Example: dynreg query monday -k 5 --hold-out kp=400 --report monday.html

    Raises UsageError where k or the budget cannot be met, LogError where the
    recording cannot be replayed.
    """
    from dynreg.neighbours.query import Spending, case_of, choose, distance_query, usual_budget
    from dynreg.neighbours.retrieve import retrieve
    from dynreg.verbs.neighbours import Subject, judged, unjudged
    from dynreg.verbs.populations import load_graph, ready

    began, k, recording = time.perf_counter(), settings.k, asked.recording
    if population is None:
        population = ready(asked.registry, recording.id, settings.population, states=settings.states)
    if k > len(population):
        raise UsageError(
            f"k = {k}",
            expected=f"1 to {len(population)}, the simulators of the population",
            do="ask for fewer neighbours, or populate more simulators",
        )
    budget = settings.budget or usual_budget(len(population.shared.robot.space), k)
    spending = Spending(k, budget, settings.replay, settings.synthesise)
    report = progress or (lambda *_: None)
    case = case_of(population, recording, hold_out=settings.hold_out, threads=settings.threads, report=report)
    graph = None
    if needs(settings.distance, "graph"):
        graph = load_graph(asked.registry, population.id, population.entries.ids)
    report("retrieve", 0, 1)
    found = retrieve(distance_query(case, graph, k), settings.distance, guess=settings.synthesise)
    report("retrieve", 1, 1)
    subject = Subject(asked, case, found, spending, began)
    if not settings.replay and not settings.synthesise:
        return unjudged(subject)
    return judged(subject, choose(case, found, spending))
