"""Which episodes: chosen against the rivals that are known, which then grow by the strongest that they have."""

from dataclasses import dataclass, field, replace

import numpy as np

from dynreg.errors import UsageError
from dynreg.evidence.lockstep import run as answered
from dynreg.evidence.truth import REACH, trial_settings
from dynreg.excite.candidates import Pool, both, pool
from dynreg.excite.limits import Limits
from dynreg.excite.playing import begins
from dynreg.excite.rivals import first_starts, strongest
from dynreg.excite.separate import Judge, Pair
from dynreg.sim.excitation import excitation, reset_pose, targets
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

CROSSED = 10  # candidates for each truth that are tried with all settings
KEPT = 30  # candidates for each truth that are kept after their first trial
SWAPS = 2  # rounds of exchanging the episodes chosen
NEAREST = 3  # rivals known that a fit begins from
SAME = 3.0  # nats that separate nothing


@dataclass
class Search:
    """Choices of `many` episodes out of a pool, and their evidence (N,) [nats] for each truth.

    usual : the choice of the usual excitation, None where the robot cannot follow it.
    """

    judge: Judge
    many: int
    usual: tuple[int, ...] | None
    rated: dict[tuple[int, ...], np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, pair: Pair, limits: Limits, steps: int, many: int) -> "Search":
        """Among patterns and the usual episodes of `steps` commands; UsageError where the robot follows none."""
        candidates, usual = (
            _candidates(pair, limits, steps),
            _usual(pair.robot, limits, steps, many, pair.seed),
        )
        judge = _judge(pair, both(candidates, usual))
        if not judge.usable.any():
            raise UsageError(
                f"robot {pair.robot.name!r} falls, diverges, hits or passes its stops in every motion that was tried",
                expected="commands that the robot can follow",
                do="lower the limits of its actions in robot.toml",
            )
        kept = np.union1d(_promising(judge, KEPT), np.arange(len(candidates), len(judge.pool)))
        judge.keep(kept)
        last = tuple(range(len(kept) - many, len(kept)))
        return cls(judge, many, last if judge.usable[list(last)].all() else None)

    def choose(self) -> tuple[int, ...]:
        """The best choice by the rivals known so far."""
        return tuple(int(i) for i in _chosen(self.judge, self.many))

    def rate(self, chosen: tuple[int, ...]) -> None:
        """Find the strongest rivals of every truth in a choice, and remember them."""
        judge = self.judge
        pair, run = judge.pair, judge.pool.run.take(np.array(chosen))
        run = replace(run, begin=begins(run))
        out = []
        for number, truth in enumerate(pair.truths):
            starts = judge.nearest(number, np.array(chosen))[:NEAREST]
            starts += [] if self.rated else first_starts(pair, 1 - truth[0])
            nats, rival = answered(strongest(pair, run, truth, starts), threads=pair.threads)
            judge.add(1 - truth[0], rival)
            out.append(nats)
        self.rated[chosen] = np.minimum(out, self.rated.get(chosen, np.inf))


def _candidates(pair: Pair, limits: Limits, steps: int) -> Pool:
    """Patterns at nominal settings, and those that promise most with every combination of settings."""
    joints = tuple(j for one in pair.terms for j in one.joints) if all(t.joints for t in pair.terms) else ()
    plain = pool(pair.robot, limits, joints, steps, pair.seed)
    settings = _settings(pair.robot)
    if len(settings) < 2:
        return plain
    best = _promising(_judge(pair, plain), CROSSED)
    return both(plain, plain.take(best).with_settings(settings))


def _promising(judge: Judge, many: int) -> np.ndarray:
    """Numbers of the candidates that tell most alone, `many` for each truth."""
    alone = np.where(judge.usable[:, None], judge.nats(np.arange(len(judge.pool))[:, None]), -np.inf)
    return np.unique(np.argsort(-alone, axis=0, kind="stable")[:many])


def _judge(pair: Pair, candidates: Pool) -> Judge:
    """A judge of the candidates, with both hypotheses at medium size as the first rivals."""
    judge = Judge(pair, candidates)
    for which, z in pair.truths:
        judge.add(which, z)
    return judge


def _chosen(judge: Judge, many: int) -> np.ndarray:
    """(many,) the best combination: one episode after the other, each then exchanged for the best beside the others."""
    at = np.flatnonzero(judge.usable)
    counts = many * judge.nats(at[:, None]).max(axis=0) >= SAME

    def best(sets: np.ndarray) -> np.ndarray:
        nats = judge.nats(sets)
        worst = nats[:, counts].min(axis=1) if counts.any() else nats.min(axis=1)
        return sets[int((worst + 1e-3 * nats.sum(axis=1)).argmax())]

    chosen = np.zeros(0, dtype=int)
    for _ in range(many):
        chosen = best(np.concatenate([np.tile(chosen, (len(at), 1)), at[:, None]], axis=1))
    for place in list(range(many)) * (SWAPS if many > 1 else 0):
        sets = np.tile(chosen, (len(at), 1))
        sets[:, place] = at
        chosen = best(sets)
    # each setting is changed as seldom as possible
    return chosen[np.lexsort((chosen, *judge.pool.run.settings[chosen].T))]


def _settings(robot: Robot) -> np.ndarray:
    """(M, K) settings to choose among: those that the commands for a diagnosis alternate between."""
    count = int(np.lcm.reduce([max(len(s.trial), 1) for s in robot.file.settings] or [1]))
    return np.unique(trial_settings(robot, count), axis=0)


def _usual(robot: Robot, limits: Limits, steps: int, many: int, seed: int) -> Pool:
    """The excitation of a usual diagnosis, from rest and back; what it draws of measured inputs nobody sets."""
    made = excitation(robot, seed=seed, name="diagnose", episodes=many, steps=steps, reach=REACH)
    kinds, given = robot.file.excitation.kinds, len(robot.file.inputs)
    made.inputs[..., :given] = robot.input_defaults[:given]
    run = Run(
        np.array(
            [limits.returned(a, reset_pose(robot), targets(robot), 1.0 / robot.rate) for a in made.actions]
        ),
        inputs=made.inputs,
        settings=trial_settings(robot, many),
        period=1.0 / robot.rate,
    )
    return Pool(tuple(f"usual {kinds[e % len(kinds)]}" for e in range(many)), run)
