"""The search for a gait on k simulators."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from dynreg.errors import UsageError, one_of
from dynreg.gait.accept import ACCEPT, EACH, USUAL
from dynreg.gait.tasks import fell as fallen
from dynreg.gait.tasks import fitness
from dynreg.gait.trials import Trials
from dynreg.rng import stream
from dynreg.search.drive import Found, Limits, Search, drive
from dynreg.search.journal import Journal
from dynreg.search.screened import after, around
from dynreg.search.seen import Seen
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES
from dynreg.sim.run import Walk

SCREENED = 0.2  # of the gaits, that are draws before a search sets out: most fall, and cost little
# The runs that then set out from different ones of the best, each worth so many gaits, share half of what is left; only
# the best goes on. See bench_gait_search.
RUNS, WORTH = 4, 150
AGAIN = 0.2  # of the rollouts, usually, in which the best gaits are tried once more
# Of that: each keeps the better half and tries them twice as often (successive halving, Jamieson 2016). The numbers
# from here on are our own choice; bench_gait_hidden judges them together.
ROUNDS = 3
DRAWS = 2  # of the first round, over all simulators
FINALISTS = 4  # at least, or none is tried again
DOUBT = 0.03  # of the ranges, 1 sigma, by which parameters move then: no simulator is the robot
# Runs of a gait that no choice has seen; they begin at a draw that no round of finals reaches.
EXPECTED, UNSEEN = 40, 10_000


@dataclass(frozen=True)
class SearchSettings:
    """How a gait is sought.

    rollouts : runs of one simulator, in all. patience : see `drive.Limits`; a search near a gait has none.
    packaged : whether the gaits that the robot's folder brings are tried first. tried : genes (n, G) of gaits that the
    robot has had, which are tried before these.
    near : whether the search stays near the first of these; see `near.seek_near`.
    meets : simulators that a batch of gaits meets, of all in turn (`Trials.in_turn`), where the search ranks within
    each batch; None for all. doubt : of the ranges, 1 sigma, by which parameters move in batches that take turns, in
    the finals and in the runs that predict a trial (once a gait has walked as `near.DOUBT` has it, for both searches).
    again : share of the rollouts in which the best gaits are tried once more, with other motor noise and parameters a
    little off: of many gaits the best is also the one that was luckiest with those of the search.
    """

    method: str = "cma"
    accept: str = USUAL
    rollouts: int = EACH
    seed: int = 0
    patience: int | None = None
    again: float = 0.0
    packaged: bool = True
    tried: tuple[tuple[float, ...], ...] = ()
    near: bool = False
    meets: int | None = None
    doubt: float = DOUBT

    def __post_init__(self):
        for name, value, choices in (
            ("method", self.method, tuple(SEARCHES)),
            ("accept", self.accept, ACCEPT),
        ):
            if value not in choices:
                raise UsageError(f"{name} {value!r}", expected=one_of(choices), do="choose one of them")
        if self.meets is not None and self.meets < 1:
            raise UsageError(f"meets = {self.meets}", expected="1 simulator or more", do="give more, or None")
        if not 0.0 <= self.again < 1.0:
            raise UsageError(f"again = {self.again}", expected="a share from 0 to below 1", do="give one")

    def finals(self, k: int) -> tuple[tuple[int, int], ...]:
        """Rounds in which the best gaits are tried again in k simulators: how many gaits, with how many draws."""
        draws = max(DRAWS // k, 1)
        gaits = int(self.again * self.rollouts) // (ROUNDS * k * draws)
        if gaits < FINALISTS:
            return ()
        return tuple((gaits >> r, draws << r) for r in range(ROUNDS) if gaits >> r > 1)

    def draws_anew(self, k: int) -> bool:
        """Whether every batch meets other noise than the one before.

        A search that ranks within one batch can have new noise each time, and finds what walks whatever the noise.
        Climbers compare candidates of different batches. So does a search that may end early.
        """
        return bool(self.finals(k)) and SEARCHES[self.method].by_order and self.patience is None

    def met(self, k: int) -> int:
        """Simulators that a batch of gaits meets, of k."""
        return min(self.meets, k) if self.meets and self.draws_anew(k) else k

    def evaluations(self, k: int) -> int:
        """Gaits of the search alone in k simulators; UsageError where the rollouts do not suffice for one batch."""
        batch, met = SEARCHES[self.method].batch, self.met(k)
        left = (self.rollouts - sum(gaits * draws * k for gaits, draws in self.finals(k))) // met
        if left < batch:
            raise UsageError(
                f"{self.rollouts} rollouts in {met} simulator{'s' if met > 1 else ''}",
                expected=f"at least {batch * met}: {batch} gaits at a time in each",
                do="raise --rollouts" if self.meets else "raise --rollouts or lower -k",
            )
        return left


@dataclass(frozen=True)
class Finals:
    """What the answer did when the best gaits were tried again: runs, falls, and the value that it was chosen by."""

    runs: int
    falls: int
    value: float


@dataclass(frozen=True, eq=False)
class Simulated:
    """What a gait (G,) did in k simulators: fitness (k,), falls (k,), and how it walked."""

    genes: np.ndarray
    fitness: np.ndarray
    fell: np.ndarray
    walk: Walk


@dataclass(frozen=True, eq=False)
class Sought(Simulated):
    """The gait that a search found, and what it did.

    found : the search alone. finals : None where no gait was tried again. packaged : number of the robot's own gait
    that the answer is, unchanged; None of a new one.
    helpless : (k,) simulators in which every gait that was tried there fell.
    """

    found: Found
    finals: Finals | None
    packaged: int | None
    helpless: np.ndarray


def simulated(trials: Trials, genes: np.ndarray) -> Simulated:
    """A gait (G,), run once in every simulator."""
    walk = trials.walk(genes[None], feet=True)
    fell = walk.fell[:, 0] < walk.base.shape[2]
    return Simulated(genes, fitness(trials.task.grade(walk)[:, 0]), fell, walk)


class Followed(TypedDict, total=False):
    """How a search is followed.

    journal : a file to go on from when the search was interrupted (`resume`); `key` is what makes it this search. It is
    the caller's to remove, when the result is safe. progress : is told the stage, and gaits done and in all.
    """

    journal: Path | None
    resume: bool
    key: Mapping[str, Any] | None
    progress: Callable[[str, int, int], None] | None


def driven(
    search: Search,
    graded: Callable[[np.ndarray], np.ndarray],
    watched: Callable[[np.ndarray], tuple[np.ndarray, ...]],
    limits: Limits,
    **followed: Unpack[Followed],
) -> Found:
    """What a search finds; graded, watched : the grades and the judge of `drive`."""
    journal, progress = followed.get("journal"), followed.get("progress")
    kept = (
        Journal(journal, followed.get("key") or {}, resume=followed.get("resume", False)) if journal else None
    )
    told = (lambda done, total: progress("search", done, total)) if progress else None
    found = drive(search, graded, watched, limits, journal=kept, progress=told)
    if progress:
        progress("search", limits.evaluations, limits.evaluations)  # the last batch may be a part of one
    return found


def seek(trials: Trials, settings: SearchSettings, **followed: Unpack[Followed]) -> Sought:
    """The gait that is worth most, of the best ones tried again where there are `finals`; the same each time.

    Where simulators take turns, gaits of different batches ran in different ones. Their losses are ranked together all
    the same. The finals, in all simulators, decide.

    Raises UsageError where the rollouts do not suffice for one batch of candidates.
    """
    space, k = trials.space, len(trials.simulators)
    met = settings.met(k)
    finals, evaluations = settings.finals(k), settings.evaluations(k)
    kind = SEARCHES[settings.method]
    search = Seen(search_of(trials, settings, evaluations))
    gaits = lambda unit: space.feasible(space.from_unit(unit))  # noqa: E731
    accepted, ran, stood = ACCEPT[settings.accept], np.zeros(k, dtype=bool), np.zeros(k, dtype=bool)

    def watched(grades: np.ndarray) -> tuple[np.ndarray, ...]:
        mine = trials.turn(search.asks - 1, met) if met < k else slice(None)
        ran[mine], stood[mine] = True, stood[mine] | ~fallen(grades).all(axis=0)
        values = accepted(fitness(grades))
        # some rank their candidates, the fallen ones too; the hill climber is the paper's
        losses = -accepted(grades) if kind.by_order else -values
        return values, losses, ranks(values, fallen(grades).sum(axis=1))

    def graded(unit: np.ndarray) -> np.ndarray:
        batch = search.asks - 1 if settings.draws_anew(k) else 0
        if met < k:
            return trials.in_turn(gaits(unit), batch, met, settings.doubt)
        return trials.grades(gaits(unit), draw=batch)

    found = driven(
        search,
        graded,
        watched,
        Limits(evaluations, settings.patience),
        **followed,
    )
    best, again = found.best, None
    if finals:
        best, again = best_again(trials, settings, search.best(finals[0][0]), finals)
    return answer(trials, best, found, again, ran & ~stood)


def ranks(values: np.ndarray, falls: np.ndarray) -> np.ndarray:
    """(n, 3) ranks of gaits, from their values (n,) and falls (n,); the first column counts most.

    A fall counts 0, and a step back less. So of gaits whose value is 0 or less, none of which achieves anything, one
    that falls less often is better.
    """
    nothing = values <= 0.0
    return np.stack([np.where(nothing, 0.0, values), np.where(nothing, -falls, 0.0), values], axis=1)


def answer(
    trials: Trials, best: np.ndarray, found: Found, finals: Finals | None, helpless: np.ndarray
) -> Sought:
    """What the best candidate (P,) is and does; the rest as `Sought` has it."""
    space = trials.space
    genes, starts = (space.feasible(space.from_unit(unit)) for unit in (best[None], space.starts))
    own = np.flatnonzero(np.isclose(starts, genes).all(axis=1))
    return Sought(
        **vars(simulated(trials, genes[0])),
        found=found,
        finals=finals,
        packaged=int(own[0]) if len(own) else None,
        helpless=helpless,
    )


def expected(
    trials: Trials, genes: np.ndarray, doubt: float = DOUBT, *, first: int = UNSEEN, moved: int | None = None
) -> np.ndarray:
    """(n, runs) grades of gaits (n, G) in all simulators, under motor noise and parameters that no choice has seen.

    doubt, first, moved : see `Trials.again`.
    """
    draws = -(-EXPECTED // len(trials.simulators))
    return trials.again(genes, draws, first=first, doubt=doubt, moved=moved).reshape(len(genes), -1)


def best_again(
    trials: Trials, settings: SearchSettings, finalists: np.ndarray, rounds: tuple[tuple[int, int], ...]
) -> tuple[np.ndarray, Finals]:
    """The best (P,) of the finalists (n, P), and what it did.

    Of those whose value reaches the task's `success` it is the one that falls least often, and of those that fall alike
    the one with the highest value: accepted over the simulators of the mean over draws. Where none does, it is the one
    with the highest value (see `ranks`).
    """
    space, seen = trials.space, np.empty((len(finalists), 0, len(trials.simulators)))
    for gaits, draws in rounds:
        finalists, seen = finalists[:gaits], seen[:gaits]
        genes = space.feasible(space.from_unit(finalists))
        new = trials.again(genes, draws, first=seen.shape[1], doubt=settings.doubt)
        seen = np.concatenate([seen, new], axis=1)
        values = ACCEPT[settings.accept](fitness(seen).mean(axis=1))
        falls = fallen(seen).sum(axis=(1, 2))
        short = values < trials.task.success
        reached = np.stack([np.zeros(len(values)), -falls, values], axis=1)
        told = np.where(short[:, None], ranks(values, falls), reached)
        order = np.lexsort((*-told.T[::-1], short))
        finalists, seen, values, falls = finalists[order], seen[order], values[order], falls[order]
    return finalists[0], Finals(seen[0].size, int(falls[0]), float(values[0]))


def search_of(trials: Trials, settings: SearchSettings, evaluations: int, most: int = RUNS) -> Search:
    """The search, of so many gaits; all try those that the robot has had, then its folder's, first.

    Who sets out from one gait tries others before: half about these, where there are some, half that swing a little
    about its pose at rest. most : runs that set out.
    """
    space, kind = trials.space, SEARCHES[settings.method]
    rng = stream(settings.seed, "gait", settings.method)
    had = space.to_unit(np.array(settings.tried).reshape(-1, len(space)))
    own = np.concatenate([had, space.starts if settings.packaged else had[:0]])
    start = Start(len(space), rng, kind.batch, periodic=space.periodic)
    if not kind.from_one:
        return after(own, kind, start)
    whole = kind.batch * max(int(SCREENED * evaluations) // kind.batch, -(-len(own) // kind.batch), 1)
    more = whole - len(own)
    about = more // 2 if len(own) else 0
    draws = [around(own, about, rng, space.periodic), space.about_rest(more - about, rng)]
    left = evaluations - whole
    runs = min(max(left // (2 * WORTH), 1), most)
    laps = left // (2 * runs * kind.batch)
    return after(np.concatenate([own, *draws]), kind, start, runs=runs, laps=laps)
