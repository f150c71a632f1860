"""Back to Reality: a gait and a simulator that make each other better, from scores of trials alone.

Paper B (Zagal and Ruiz-del-Solar, "Combining Simulation and Reality in Evolutionary Robotics", 2007). In turn: a
genetic algorithm seeks gaits in the simulator (step 1); the best of them are tried on the robot (2); a genetic
algorithm over simulators makes the scores there like those on the robot (3); the best gait is refined on the robot by
a policy gradient (4). No state of the robot is ever read. Gaits and simulators are points in unit cubes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynreg.adapt.differences import DIFFERENCES
from dynreg.adapt.journalled import Outcome
from dynreg.adapt.searched import searched
from dynreg.adapt.tried import (
    ADAPTED,
    BACK,
    REFINE,
    ROULETTE,
    START,
    TRANSFER,
    Adapted,
    Reached,
    Rules,
    Tried,
    best_of,
)
from dynreg.adapt.world import World
from dynreg.errors import BudgetError
from dynreg.search.bits import BYTE, grid, roulette
from dynreg.search.drive import Limits, Search, drive
from dynreg.search.journal import Journal
from dynreg.search.seen import Seen
from dynreg.search.start import Start
from dynreg.search.table import SEARCHES

NEAR = 0.99 * grid(BYTE)  # of the range: two codes of step 1 are farther apart
BESIDE = 0.05  # of the range, 1 sigma, between a simulator and those beside it: our choice
FEWEST = 2  # gaits that stood on the robot, with which a simulator can be adapted
KNOWN = 0.5  # of the gaits that must stand in step 2: so many at most are gaits to begin with. Our choice


def back_to_reality(
    world: World,
    rules: Rules,
    gaits: np.ndarray,
    simulator: np.ndarray,
    free: np.ndarray,
    seeds: np.ndarray | None = None,
) -> Reached:
    """Steps 1 to 5, from a simulator (P,) of which the numbers `free` (F,) are adapted.

    gaits : (n, G) that the robot may be known to run, or none; they are tried first, until a share of `KNOWN` stood.
    seeds : (n, G) for the first generation of step 1, such as those of a goal nearby; nobody knows whether the robot
    can run them. It ends when the goal is met, at the last iteration, or when the budget of the robot is spent.
    """
    seeds = gaits[:0] if seeds is None else seeds
    run = _Run(world, rules, gaits, seeds, free, [Adapted(simulator, 0, START)])
    ended = "iterations"
    try:
        for number in range(1, rules.iterations + 1):
            if run.iterate(number):
                ended = "goal"
                break
    except BudgetError as spent:
        ended = spent.what
    return Reached(tuple(run.versions), tuple(run.tried), run.best, ended, run.resumed)


@dataclass(eq=False)
class _Run:
    """One run: what is asked, and what has come of it."""

    world: World
    rules: Rules
    known: np.ndarray
    seeds: np.ndarray
    free: np.ndarray
    versions: list[Adapted]
    tried: list[Tried] = field(default_factory=list)
    halved: int = 0
    resumed: int = 0

    @property
    def best(self) -> Tried | None:
        """See `best_of`."""
        return best_of(self.tried, self.rules.repeats)

    @property
    def met(self) -> bool:
        """Whether the goal is met."""
        best, goal = self.best, self.rules.goal
        enough = best is not None and len(best.trials) >= self.rules.repeats
        return goal is not None and enough and best.score >= goal

    def iterate(self, number: int) -> bool:
        """One iteration; whether the goal is met. Raises BudgetError where the robot may not be tried any more."""
        over, first = None, len(self.tried)
        candidates = self.sought(number)
        try:
            self.transfer(number, candidates)
        except BudgetError as spent:
            over = spent  # to adapt the simulator to what was tried costs no trial
        here = self.tried[first:]
        if self.met:
            return True
        proposed = [one for one in here if one.simulated is not None]
        # a budget may end with the falls that it allows: so few gaits say nothing of the simulator
        if over is None and sum(one.fell for one in proposed) >= self.rules.lost * len(proposed) > 0:
            self.disengage(number)
        else:
            self.adapt(number, [one for one in here if not one.fell])
        if over is not None:
            raise over
        return self.refined(number)

    def journal(self, step: str, *by: np.ndarray) -> Journal | None:
        """The journal of a step; a run with another budget may have come to it with other simulators, gaits, scores."""
        made = self.world.journal(step)
        if made is not None:
            made.shaped(*by)
        return made

    def sought(self, number: int) -> list[tuple[np.ndarray, float | None]]:
        """Step 1: gaits and their simulated fitness, the best of the last generation first, then of those before.

        Real gaits and seeds are in the first generation. In the first iteration, those to begin with come before all.
        Gaits that fall in the simulator are left out.
        """
        rules = self.rules
        generations = max((rules.first if number == 1 else rules.later) >> self.halved, 1)
        known = self.real(rules.gaits)
        begun = np.concatenate([known, self.seeds])[: rules.gaits]
        rng = self.world.rng(f"gaits {number}")
        near = self.near(number)
        target = -np.inf if rules.hope is None else -rules.hope
        search = Seen(_Until(self.begun(rng, begun), target))
        found = drive(
            search,
            lambda some: self.world.play(some, near).min(axis=0)[:, None],
            lambda grades: (grades[:, 0], -grades[:, 0]),
            Limits(generations * rules.gaits),
            journal=self.journal(f"gaits {number}", near, begun),
            progress=lambda done, total: self.world.progress(f"gaits {number}", done, total),
        )
        self.resumed += found.resumed * len(near)
        out = [(gait, None) for gait in known] if number == 1 else []
        rounds = search.rounds()
        if rules.search != ROULETTE:  # others have no generations
            rounds = [tuple(map(np.concatenate, zip(*rounds, strict=True)))]
        for asked, losses in reversed(rounds):
            order = np.argsort(losses, kind="stable")
            out += [(asked[i], -float(losses[i])) for i in order if losses[i] < 0.0]
        return out

    def near(self, number: int) -> np.ndarray:
        """(k, P) the simulator of step 1, and others beside it.

        A gait that scores in one simulator alone, such as by a ball that hits the one paw and then the other, is not
        found again on the robot.
        """
        out = np.tile(self.versions[-1].simulator, (self.rules.near, 1))
        if self.rules.near > 1:
            rng = self.world.rng(f"near {number}")
            out[1:, self.free] += BESIDE * rng.standard_normal((len(out) - 1, len(self.free)))
        return np.clip(out, 0.0, 1.0)

    def begun(self, rng: np.random.Generator, first: np.ndarray) -> Search:
        """The search of step 1, from gaits (n, G): all are of the first generation, or the first is where it begins."""
        rules, genes = self.rules, self.known.shape[1]
        if rules.search == ROULETTE:
            return roulette(genes, rng, rules.gaits, first, rules.mutation)
        point = first[0] if len(first) else None
        return SEARCHES[rules.search].begin(Start(genes, rng, rules.gaits, point, self.world.periodic))

    def real(self, most: int) -> np.ndarray:
        """(n, G) at most so many gaits that stood on the robot in all of their trials, the best first.

        Gaits that were tried once are left out, as long as others stood: the best of many is a lucky one, and the
        small steps of step 4 would fill the generation with copies of one gait. Where none stood, those to begin with.
        """
        stood = [one for one in self.tried if not one.fell]
        stood = [one for one in stood if len(one.trials) >= self.rules.repeats] or stood
        best = sorted(stood, key=lambda one: -one.score)[:most]
        return np.array([one.gait for one in best]) if best else self.known[:most]

    def transfer(self, number: int, candidates: Sequence[tuple[np.ndarray, float | None]]) -> None:
        """Step 2: gaits are tried until enough stood, or so many fell that there is no hope, or the goal is met.

        Gaits to begin with leave room for those of the simulator, and where they fall, this says nothing of it. None
        is tried twice: gaits that are nearer than the codes of step 1 are taken for one, such as a gait and its code.
        """
        if not candidates:
            return
        stand, lost, here = self.rules.stand, self.rules.lost, []
        stood = fell = 0
        played = self.world.played(np.array([gait for gait, _ in candidates]))
        for (gait, simulated), as_played in zip(candidates, played, strict=True):
            if stood == stand or fell >= stand * lost / (1.0 - lost):
                return
            if simulated is None and stood >= int(KNOWN * stand):
                continue
            if here and self.world.apart(as_played, np.array(here)).min() < NEAR:
                continue
            here.append(as_played)
            one = self.try_out(gait, number, TRANSFER, self.rules.repeats, simulated)
            stood, fell = stood + (not one.fell), fell + (one.fell and simulated is not None)
            self.world.progress(f"robot {number}", stood, stand)
            if self.met:
                return

    def try_out(
        self, gait: np.ndarray, number: int, step: str, repeats: int, simulated: float | None = None
    ) -> Tried:
        """Trials of a gait on the robot, up to a fall; what the budget leaves of them counts."""
        made: list[Outcome] = []
        try:
            while len(made) < repeats and not any(one.fell for one in made):
                made.append(self.world.trial(gait))
        finally:
            if made:
                trials, scores = zip(*((one.number, one.score) for one in made), strict=True)
                self.tried.append(Tried(gait, number, step, trials, scores, simulated))
        return self.tried[-1]

    def adapt(self, number: int, stood: Sequence[Tried]) -> None:
        """Step 3: the simulator in which gaits score most like on the robot."""
        if len(stood) < FEWEST:
            return
        rules, parent = self.rules, self.versions[-1]
        gaits, real = np.array([one.gait for one in stood]), np.array([one.score for one in stood])

        def difference(simulators: np.ndarray) -> np.ndarray:
            return DIFFERENCES[rules.difference](self.world.play(gaits, simulators), real)

        first, name = float(difference(parent.simulator[None])[0]), f"simulators {number}"
        # a difference that may be negative has no share that is near enough
        target = rules.enough * first if first > 0.0 else -np.inf
        rng, kind = self.world.rng(name), SEARCHES[ROULETTE]
        found = searched(
            difference,
            parent.simulator,
            self.free,
            lambda point: _Until(kind.begin(Start(len(point), rng, rules.simulators, point)), target),
            Limits(1 + rules.turns * rules.simulators),
            most=0.0,
            journal=self.journal(name, parent.simulator, gaits, real),
            progress=lambda done, total: self.world.progress(name, done, total),
        )
        self.resumed += found.resumed * len(gaits)
        numbers = tuple(n for one in stood for n in one.trials)
        made = Adapted(found.unit, number, ADAPTED, len(self.versions) - 1, numbers, found.first, found.last)
        self.versions.append(made)

    def disengage(self, number: int) -> None:
        """The simulator tells too little of the robot: the one before is taken again, and step 1 becomes shorter."""
        self.halved += 1
        parent = self.versions[-1].parent
        if parent is not None:
            before = self.versions[parent]
            self.versions.append(Adapted(before.simulator, number, BACK, before.parent, before.trials))

    def refined(self, number: int) -> bool:
        """Step 4: small steps of the best gait on the robot; whether the goal is met.

        Each gait is tried once. The best of them is tried again, for itself, at the end and where it meets the goal.
        """
        if self.best is None:
            return False
        rules, single = self.rules, []
        rng = self.world.rng(f"refine {number}")
        start = Start(len(self.best.gait), rng, rules.variations, self.best.gait, self.world.periodic)
        search = SEARCHES["policy"].begin(start)
        for turn in range(rules.steps):
            made = [self.try_out(gait, number, REFINE, 1) for gait in search.ask()]
            search.tell(-np.array([one.score for one in made]))
            self.world.progress(f"refine {number}", turn + 1, rules.steps)
            single += made
            if rules.goal is not None:
                self.confirm(number, single, rules.goal)
            if self.met:
                return True
        self.confirm(number, single, float(np.nextafter(self.best.score, np.inf)))
        return self.met

    def confirm(self, number: int, single: list[Tried], least: float) -> None:
        """Try the best of gaits that were tried once again, where it scored at least so much, and take it from them."""
        if self.rules.repeats == 1:
            return
        hopes = [one for one in single if not one.fell and one.score >= least]
        if hopes:
            one = max(hopes, key=lambda one: one.score)
            single.remove(one)
            self.try_out(one.gait, number, REFINE, self.rules.repeats)


class _Until:
    """A search that has ended once a loss is as low as `target`, and by nothing else.

    CMA-ES itself would end where all of a generation fall.
    """

    middle = None

    def __init__(self, search: Search, target: float):
        self._search, self._target, self.stopped = search, target, False

    def ask(self) -> np.ndarray:
        return self._search.ask()

    def tell(self, losses: np.ndarray) -> None:
        self._search.tell(losses)
        self.stopped = bool((losses <= self._target).any())
