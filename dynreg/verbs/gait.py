"""Gait: joint commands that walk in the simulators that stand for a recording's robot."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynreg.gait.accept import ACCEPT, USUAL
from dynreg.verbs.settings import Settings, method, option, seed, threads
from dynreg.verbs.simulators import NOMINAL, OLD, WORDS
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    from dynreg.gait.seek import SearchSettings
    from dynreg.results.gait import Gait
    from dynreg.verbs.subjects import Recorded

SOURCES = (*WORDS, NOMINAL, "random", "population")
OF_POPULATION = "mean"  # is raised: some draws of the ranges cannot even stand, and their minimum is 0


@dataclass(frozen=True)
class GaitSettings(Settings):
    """What `gait` can be told."""

    k: int = option(5, "Simulators that the gait must walk in.", flag="-k", least=1, shared=True)
    on: str = option(
        SOURCES[0], f"Simulators: {', '.join(SOURCES)}, or their ids with commas between them.", old=OLD
    )
    method: str = method()
    accept: str | None = option(
        None,
        "What the search raises over the simulators.",
        choices=tuple(ACCEPT),
        usual=f"{USUAL}; of a population the {OF_POPULATION}",
    )
    task: str | None = option(None, "One of the robot's [[tasks]].", usual="its first")
    rollouts: int = option(750, "Runs of one simulator that the search may cost.", least=1)
    patience: int | None = option(
        None, "Give up after so many gaits without a better one.", usual="never", least=1
    )
    resume: bool = option(False, "Go on with an interrupted search.")
    population: str | None = option(
        None, "Population to choose from.", usual="the only one", complete="stored_names"
    )
    seed: int = seed()
    threads: int = threads()

    @property
    def search(self) -> "SearchSettings":
        """How the gait is sought."""
        from dynreg.gait.seek import AGAIN, SearchSettings

        accept = self.accept or (OF_POPULATION if self.on == "population" else USUAL)
        return SearchSettings(
            self.method, accept, self.rollouts, self.seed, patience=self.patience, again=AGAIN
        )


def gait(asked: "Recorded", settings: GaitSettings, progress: Progress | None = None) -> "Gait":
    """Seek a gait that walks in the simulators nearest to a recording.

    The gait is stored; a search that was interrupted goes on where it was with --resume.

    Example: dynreg gait monday -k 5 --rollouts 2500

    Raises RobotError where the robot has no such task, NoMatchError where no simulator is close enough, UsageError
    where there are too few.
    """
    from dynreg.gait.seek import seek
    from dynreg.gait.space import gait_space
    from dynreg.gait.tasks import task_of
    from dynreg.gait.trials import Trials, simulators_of
    from dynreg.replay.known import command_rate, known_values
    from dynreg.verbs.gait_document import document, journal
    from dynreg.verbs.gait_simulators import choose
    from dynreg.verbs.query import QuerySettings

    began = time.perf_counter()
    robot, search = asked.robot, settings.search
    task = task_of(robot, settings.task)
    gait_space(robot)  # before anything is asked of the registry
    wanted = QuerySettings(k=settings.k, population=settings.population, threads=settings.threads)
    chosen = choose(asked, settings.on, wanted, settings.seed, progress)
    known = known_values(robot, asked.recording)
    simulators = simulators_of(robot, [one.config for one in chosen.simulators], known)
    rate = command_rate(robot, known)
    trials = Trials(robot, task, simulators, rate=rate, seed=settings.seed, threads=settings.threads)
    key, path = journal(asked, chosen, trials, search)
    sought = seek(trials, search, journal=path, resume=settings.resume, key=key, progress=progress)
    found = document(asked, chosen, trials, search, sought, time.perf_counter() - began)
    asked.keep(found)
    path.unlink(missing_ok=True)  # not before the gait is stored
    return found
