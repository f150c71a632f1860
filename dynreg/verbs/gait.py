"""Gait: joint commands that make a legged robot walk in the simulators that a recording tells of."""

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dynreg.gait.accept import ACCEPT, EACH, USUAL
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, method, option, seed, threads
from dynreg.verbs.simulators import NOMINAL, OLD, POSTERIOR, WORDS

if TYPE_CHECKING:
    from dynreg.gait.seek import SearchSettings
    from dynreg.results.gait import Gait
    from dynreg.verbs.subjects import Recorded

SOURCES = (POSTERIOR, *WORDS, NOMINAL, "random", "population")
# Where a gait is sought: in the query's answer and draws that the recording cannot tell apart from it. What is sought
# in the answer alone is quick and falls; what must walk in the nearest five (the paper's way) creeps (bench_gait_ways).
ON = POSTERIOR
SEVERAL = ("nearest", "random", "population")  # which mean k simulators
MANY = 16  # simulators of the posterior at most, the answer among them
MEETS, DOUBT, ROLLOUTS = 4, 0.05, 7500  # of a search in them: see `SearchSettings`
NEARBY = 0.2  # of these rollouts, for the search near a gait that walked: there a gait costs a run, not four
# The mean is raised where simulators are drawn. Some draws of the ranges cannot even stand, so the minimum would be 0;
# with the minimum over draws of the posterior, gaits creep.
MEAN, DRAWN = "mean", (POSTERIOR, "population")


@dataclass(frozen=True)
class GaitSettings(Settings):
    """The settings of `gait`."""

    k: int = option(
        5,
        f"Simulators with --on {', '.join(SEVERAL)}; else neighbours of the query.",
        flag="-k",
        least=1,
        shared=True,
    )
    on: str = option(ON, f"Simulators: {', '.join(SOURCES)}, or their ids with commas between them.", old=OLD)
    method: str = method()
    accept: str | None = option(
        None,
        "Statistic over the simulators that the search maximises.",
        choices=tuple(ACCEPT),
        usual=f"{USUAL}; with --on {' or '.join(DRAWN)} the {MEAN}",
    )
    task: str | None = option(None, "One of the robot's [[tasks]].", usual="its first")
    rollouts: int | None = option(
        None,
        "Most simulator runs of the search.",
        usual=f"{ROLLOUTS} with --on {POSTERIOR}, else {EACH} for each simulator",
        least=1,
    )
    patience: int | None = option(
        None, "Stop after this many gaits without a better one.", usual="never", least=1
    )
    packaged: bool = option(True, "Also try the gaits that the robot's folder brings.")
    resume: bool = option(False, "Continue an interrupted search.")
    population: str | None = option(
        None, "Population in which to search.", usual="the only one", complete="stored_names"
    )
    seed: int = seed()
    threads: int = threads()

    def many(self) -> int:
        """Most simulators in which the search may run: of draws as many as its rollouts can try finalists in."""
        from dynreg.gait.seek import AGAIN, FINALISTS, ROUNDS

        if self.on == POSTERIOR:
            return min(max(int(AGAIN * (self.rollouts or ROLLOUTS)) // (ROUNDS * FINALISTS), 1), MANY)
        return self.k if self.on in SEVERAL else 1

    def search(self, many: int) -> "SearchSettings":
        """The settings of the search of the whole range in so many simulators."""
        return self.searches(many, walked=False)[0]

    def searches(self, many: int, *, walked: bool) -> "tuple[SearchSettings, ...]":
        """The searches in so many simulators, which share the rollouts.

        walked : whether a gait has walked: the first search stays near it. Where simulators take turns, a second one is
        of the whole range.
        """
        from dynreg.gait.near import DOUBT as NEAR
        from dynreg.gait.seek import AGAIN, SearchSettings

        drawn = self.on == POSTERIOR
        rollouts = self.rollouts or (ROLLOUTS if drawn else EACH * many)
        whole = SearchSettings(
            self.method,
            self.accept or (MEAN if self.on in DRAWN else USUAL),
            rollouts,
            self.seed,
            self.patience,
            AGAIN,
            self.packaged,
            **({"meets": MEETS, "doubt": DOUBT} if drawn else {}),
        )
        if not walked:
            return (whole,)
        near = replace(whole, near=True, doubt=NEAR)
        if not drawn:
            return (near,)
        share = int(NEARBY * rollouts)
        return replace(near, rollouts=share), replace(whole, rollouts=rollouts - share)


@dataclass(frozen=True)
class Had:
    """The gaits that the robot has had: genes of each, the best first, and whether that one walked.

    simulators : ids of those in which they were sought. reached : the fitness of the best on the robot.
    """

    genes: tuple[tuple[float, ...], ...] = ()
    walked: bool = False
    simulators: tuple[str, ...] = ()
    reached: float = 0.0


def gait(
    asked: "Recorded",
    settings: GaitSettings,
    progress: Progress | None = None,
    *,
    had: Had = Had(),  # noqa: B008  frozen
) -> "Gait":
    """Search for a gait that walks in the query's simulators.

    The gait is stored. An interrupted search resumes with --resume. With --trial, gaits are tried on the robot in turn,
    and the trials' logs tell in which simulators the next one is sought.

    Example: dynreg gait monday --rollouts 15000

    Raises RobotError if the robot has no such task, NoMatchError if no simulator is close enough, UsageError if there
    are too few simulators.
    """
    from dynreg.gait.near import likelier, may_stay, seek_near
    from dynreg.gait.seek import expected, seek
    from dynreg.gait.space import gait_space
    from dynreg.gait.tasks import task_of
    from dynreg.gait.trials import Trials, simulators_of
    from dynreg.replay.known import command_rate, known_values
    from dynreg.verbs.gait_document import document, journal
    from dynreg.verbs.gait_simulators import choose, with_earlier
    from dynreg.verbs.query import QuerySettings

    began = time.perf_counter()
    robot = asked.robot
    task = task_of(robot, settings.task)
    gait_space(robot, task.motion)  # raises its errors before the registry is read, as too few rollouts do
    many = settings.many()
    settings.search(many).evaluations(many)
    wanted = QuerySettings(k=settings.k, population=settings.population, threads=settings.threads)
    chosen = choose(asked, settings.on, wanted, many, settings.seed, progress)
    near, turns = had.walked and may_stay(settings.method), settings.on == POSTERIOR
    searches = settings.searches(len(chosen.simulators), walked=near)
    searches = [replace(one, tried=had.genes) for one in searches]
    if near or turns:
        most = replace(settings, rollouts=searches[-1].rollouts).many() if turns else None
        chosen = with_earlier(asked, chosen, had.simulators, most)
    known = known_values(robot, asked.recording)
    simulators = simulators_of(robot, [one.config for one in chosen.simulators], known)
    rate = command_rate(robot, known)
    trials = Trials(robot, task, simulators, rate=rate, seed=settings.seed, threads=settings.threads)
    keys, paths = zip(*(journal(asked, chosen, trials, one) for one in searches), strict=True)
    sought = [
        (seek_near if one.near else seek)(
            trials, one, journal=path, resume=settings.resume, key=key, progress=progress
        )
        for one, key, path in zip(searches, keys, paths, strict=True)
    ]
    genes = [one.genes for one in sought]
    best = likelier(trials, searches[0], had.reached, genes) if len(genes) > 1 else 0
    unseen = expected(trials, genes[best], searches[best].doubt)
    about, seconds = (asked.recording.id, asked.name), time.perf_counter() - began
    found = document(robot, about, chosen, trials, searches[best], sought[best], unseen, seconds)
    asked.keep(found)
    for path in paths:
        path.unlink(missing_ok=True)  # only after the gait is stored
    return found
