"""Gait: joint commands that make a legged robot walk in the simulators that a recording tells of."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dynreg.gait.accept import ACCEPT, EACH, USUAL
from dynreg.gait.had import Had
from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, method, option, seed, threads
from dynreg.verbs.simulator import NOMINAL, OLD, POSTERIOR, QUERIED, WORDS

if TYPE_CHECKING:
    from dynreg.gait.seek import SearchSettings
    from dynreg.results.gait import Gait
    from dynreg.verbs.subjects import Recorded

SOURCES = (POSTERIOR, *WORDS, NOMINAL, "random", "population")
# Where a gait is sought: in the query's answer and draws that the recording cannot tell apart from it. What is sought
# in the answer alone is quick and falls; what must walk in the nearest five (the paper's way) is half as quick
# (bench_gait_ways).
ON = POSTERIOR
SEVERAL = ("nearest", "random", "population")  # which mean k simulators
USING = {"k": (*dict.fromkeys((*QUERIED, *SEVERAL)),), "population": (*QUERIED, "random")}  # by a setting
MANY = 16  # simulators of the posterior at most, the answer among them
# Of a search in them, see `SearchSettings`: by seven quadrupeds of the development. bench_gait_ways and `rounds` of
# bench_gait_hidden have what they bring on others.
MEETS, DOUBT, ROLLOUTS = 4, 0.05, 7500
# Of these rollouts, for the search near a gait that walked. There a gait costs one run, not four: a quarter of the
# rollouts tries as many gaits as all of them would in the whole range. What it found went farther than the gait that
# walked on six of six quadrupeds of the development.
NEARBY = 0.25
# The mean is raised where simulators are drawn. Some draws of the ranges cannot even stand, so the minimum would be 0.
# Over draws of the posterior, the minimum, the lower quartile and the mean do alike (bench_gait_ways).
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
        None,
        "Stop a search of the whole range after this many gaits without a better one.",
        usual="never",
        least=1,
    )
    packaged: bool = option(True, "Also try the gaits that the robot's folder brings.")
    resume: bool = option(False, "Continue an interrupted search; with --trial it goes on without this.")
    population: str | None = option(
        None, "Population in which to search.", usual="the only one", complete="stored_names"
    )
    seed: int = seed()
    threads: int = threads()

    @property
    def unused(self) -> tuple[str, ...]:
        """Settings of a query or of draws, where the simulators come from neither."""
        return tuple(name for name, on in USING.items() if self.on not in on)

    def meant(self) -> None:
        """UsageError for a setting that has no meaning in these simulators: it would be left unused."""
        for name in self.unused:
            self.refuse((name,), f"with --on {self.on}", f"--on {' or '.join(USING[name])}")

    @property
    def turns(self) -> bool:
        """Whether simulators take turns, so that a gait costs as many runs however many there are."""
        return self.on == POSTERIOR

    def most_chosen(self) -> int:
        """Most simulators that are chosen anew: of draws as many as the rollouts can try finalists in."""
        from dynreg.gait.seek import AGAIN, FINALISTS, ROUNDS

        if self.turns:
            return min(max(int(AGAIN * (self.rollouts or ROLLOUTS)) // (ROUNDS * FINALISTS), 1), MANY)
        return self.k if self.on in SEVERAL else 1

    def most_in_all(self, searches: "Sequence[SearchSettings]") -> int | None:
        """Most simulators of these searches, those of earlier logs among them; None for any number."""
        from dynreg.gait.near import most_simulators

        if not self.turns:
            return None
        each = (
            most_simulators(one.rollouts) if one.near else replace(self, rollouts=one.rollouts).most_chosen()
            for one in searches
        )
        return min(MANY, *each)

    def search(self, many: int) -> "SearchSettings":
        """The settings of the search of the whole range in so many simulators."""
        from dynreg.gait.seek import AGAIN, SearchSettings

        accept = self.accept or (MEAN if self.on in DRAWN else USUAL)
        rollouts = self.rollouts or (ROLLOUTS if self.turns else EACH * many)
        turns = {"meets": MEETS, "doubt": DOUBT} if self.turns else {}
        return SearchSettings(
            self.method, accept, rollouts, self.seed, self.patience, AGAIN, self.packaged, **turns
        )

    def searches(self, many: int, walked: bool) -> "tuple[SearchSettings, ...]":
        """The searches in so many simulators: of the whole range, near a gait that `walked`, or both.

        Two share the rollouts, the one near the gait first: where simulators take turns, and its share suffices for a
        batch of gaits.
        """
        from dynreg.gait.near import DOUBT as NEAR
        from dynreg.gait.near import may_stay
        from dynreg.search.table import SEARCHES

        whole = self.search(many)
        if not (walked and may_stay(self.method)):
            return (whole,)
        near, share = replace(whole, near=True, doubt=NEAR), int(NEARBY * whole.rollouts)
        if not self.turns or share < SEARCHES[self.method].batch:
            return (near,)
        return replace(near, rollouts=share), replace(whole, rollouts=whole.rollouts - share)


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
    are too few simulators, a setting has no meaning in them or another run of the same search has not ended.
    """
    from dynreg.gait.forecast import best_first
    from dynreg.gait.seek import expected
    from dynreg.gait.space import gait_space
    from dynreg.gait.tasks import task_of
    from dynreg.verbs.gait_document import document
    from dynreg.verbs.gait_searches import kept, searched
    from dynreg.verbs.gait_simulators import choose, trials_in, with_earlier
    from dynreg.verbs.query import QuerySettings

    began = time.perf_counter()
    settings.meant()
    robot = asked.robot
    task = task_of(robot, settings.task)
    gait_space(robot, task.motion)  # raises its errors before the registry is read, as too few rollouts do
    many = settings.most_chosen()
    settings.search(many).evaluations(many)
    wanted = QuerySettings(k=settings.k, population=settings.population, threads=settings.threads)
    chosen = choose(asked, settings.on, wanted, many, settings.seed, progress)
    searches = settings.searches(len(chosen.simulators), any(had.walked))
    if settings.turns or searches[0].near:
        chosen = with_earlier(asked, chosen, had.simulators, settings.most_in_all(searches))
    trials = trials_in(asked, task, chosen.simulators, seed=settings.seed, threads=settings.threads)
    if searches[0].near:
        had = best_first(trials, had)
    with kept(asked, chosen, trials, searches, had, resume=settings.resume) as journals:
        best = searched(trials, journals, had, progress)
        # once a gait has walked, both searches foresee what they bring with the doubt of the one near it
        (unseen,) = expected(trials, best.sought.genes[None], searches[0].doubt)
        about, seconds = (asked.recording.id, asked.name), time.perf_counter() - began
        found = document(about, chosen, trials, best, unseen, seconds)
        asked.keep(found)
    return found
