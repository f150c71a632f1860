"""Excite: commands within the robot's limits that drive two hypotheses apart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.candidates import Limits, Pool, both, pool
from dynreg.diagnose.experiment import PAUSE, experiment, recording
from dynreg.diagnose.rivals import strongest
from dynreg.diagnose.separate import Judge, Pair
from dynreg.diagnose.truth import REACH, trial_settings
from dynreg.errors import RobotError, UsageError
from dynreg.results import Experiment
from dynreg.sim.effects import Term, term
from dynreg.sim.excitation import excitation, reset_pose
from dynreg.sim.robot import Robot
from dynreg.sim.run import Run

SHORT = 2.5  # s of an episode, and of the longest ones:
LONG = 10.0
EPISODES = 4  # at least: a diagnosis fits, selects and tests by different ones
FEWEST = 20  # commands of an episode
CROSSED = 10  # candidates of each truth that are tried with all settings
SAME = 3.0  # nats that separate nothing
SWAPS = 2  # rounds of exchanging the episodes chosen
ROUNDS = 3  # of choosing episodes, each against the rivals that the last one left
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Choice:
    """Episodes, the lowest and highest states expected in them (E, 2, S), and the evidence (N,) that they give.

    nats : for each truth, against its strongest rival. usual : the same of the usual excitation of this length.
    """

    pool: Pool
    reached: np.ndarray
    nats: np.ndarray
    usual: np.ndarray | None


def excite(
    robot: Robot,
    between: tuple[str, str],
    *,
    seconds: float,
    seed: int,
    progress: Progress | None = None,
) -> tuple[Recording, Experiment]:
    """Commands of `seconds` that tell the effects `between` apart, and the evidence to expect of them.

    Patterns of several reaches and speeds are tried, with the `trial` settings of robot.toml. Either effect is taken
    for true, at medium size and with either sign, and the other fitted to it: what counts is the evidence in the worst
    of these cases. Where one effect contains the other, only cases count in which it is true.

    Raises UsageError where no commands separate the two (they are of one exact group, or move the robot alike),
    where an effect cannot act on the robot, or where `seconds` are too few; RobotError for a robot without commands
    or without a fixed command rate.
    """
    pair = Pair(robot, _terms(robot, between), seed)
    limits = Limits.of(robot)
    lengths = _lengths(robot, seconds)
    total, done = len(lengths) * (ROUNDS + 1), 0
    found: list[Choice] = []
    for steps, many in lengths:
        for choice in _rounds(pair, limits, steps, many):
            found.append(choice)
            done += 1
            if progress:
                progress("excite", done, total)
    if progress:
        progress("excite", total, total)
    counts = _counts(pair, found)
    best = max(found, key=lambda choice: choice.nats[counts].min())
    return recording(robot, best.pool, between, seed), experiment(
        robot,
        between,
        limits,
        best.pool,
        best.reached,
        nats=float(best.nats[counts].min()),
        usual=None if best.usual is None else float(best.usual[counts].min()),
        decided_by={h for (h, _), yes in zip(pair.truths, counts, strict=True) if yes},
    )


def _terms(robot: Robot, between: tuple[str, str]) -> tuple[Term, Term]:
    """The two terms; UsageError where they cannot act on the robot, or no commands tell them apart."""
    if not robot.actions:
        raise RobotError(
            f"robot {robot.name!r} takes no commands", expected="[[actions]]", do="excite it by hand"
        )
    first, second = term(between[0]), term(between[1])
    owners = {name.split("/")[0] for name in robot.actions}
    for one in (first, second):
        unknown = sorted(set(one.joints) - owners)
        reason = one.effect.why_not(robot) or (f"no action drives {unknown[0]!r}" if unknown else None)
        if reason:
            raise UsageError(
                f"effect {one.key!r} on robot {robot.name!r}: {reason}",
                expected="two effects that can act there",
                do=f"see `dynreg effects {robot.name}`",
            )
    group, other = first.effect.group, second.effect.group
    if first.key == second.key or (group and group == other and first.effect is not second.effect):
        raise UsageError(
            f"no commands tell {first.key} from {second.key}: both make the same motions",
            expected="two effects of different groups",
            do=_by_hand((first, second)),
        )
    return first, second


def _lengths(robot: Robot, seconds: float) -> list[tuple[int, int]]:
    """(commands, episodes) to try: short episodes, and long ones for what changes slowly."""
    longest = robot.file.replay.horizon or LONG
    out = {}
    for length in (min(SHORT, longest), longest):
        many = max(EPISODES, round(seconds / length))
        out[round(min(seconds / many, longest) * robot.rate)] = many
    if min(out) < FEWEST:
        raise UsageError(
            f"{seconds:g} s of commands at {robot.rate:g} Hz",
            expected=f"at least {EPISODES * FEWEST / robot.rate:g} s",
            do="ask for more seconds",
        )
    return sorted(out.items())


def _rounds(pair: Pair, limits: Limits, steps: int, many: int) -> Iterator[Choice]:
    """Choices of `many` episodes of `steps` commands: the usual ones, then each round's best.

    Each is chosen against all the rivals known so far, and leaves the strongest ones that it has as further rivals.
    """
    candidates, usual = _candidates(pair, limits, steps), _usual(pair.robot, limits, steps, many, pair.seed)
    judge = _judge(pair, both(candidates, usual))
    chosen = np.arange(len(candidates), len(judge.pool))
    known, rated = None, set()
    if judge.usable[chosen].all():
        known = _evidence(judge, chosen)
        yield Choice(usual, judge.reached[chosen], known, known)
    for _ in range(ROUNDS):
        if not judge.usable.any():
            raise UsageError(
                f"robot {pair.robot.name!r} falls, diverges or passes its stops in every motion that was tried",
                expected="commands that the robot can follow",
                do="lower the limits of its actions in robot.toml",
            )
        chosen = _chosen(judge, many)
        if tuple(chosen) in rated:
            return
        rated.add(tuple(chosen))
        yield Choice(judge.pool.take(chosen), judge.reached[chosen], _evidence(judge, chosen), known)


def _candidates(pair: Pair, limits: Limits, steps: int) -> Pool:
    """Patterns at nominal settings, and those that promise most with every combination of settings."""
    joints = tuple(j for one in pair.terms for j in one.joints) if all(t.joints for t in pair.terms) else ()
    plain = pool(pair.robot, limits, joints, steps, pair.seed)
    settings = _settings(pair.robot)
    if len(settings) < 2:
        return plain
    judge = _judge(pair, plain)
    alone = np.where(judge.usable[:, None], judge.nats(np.arange(len(plain))[:, None]), -np.inf)
    most = np.argsort(-alone, axis=0, kind="stable")[:CROSSED]
    return both(plain, plain.take(np.unique(most)).with_settings(settings))


def _judge(pair: Pair, candidates: Pool) -> Judge:
    """A judge of the candidates, with both hypotheses at medium size as the first rivals."""
    judge = Judge(pair, candidates)
    for which, z in pair.truths:
        judge.add(which, z)
    return judge


def _chosen(judge: Judge, many: int) -> np.ndarray:
    """(many,) the best combination: one episode after the other, each then exchanged for the best beside the others."""
    at = np.flatnonzero(judge.usable)
    first = np.array([which == 0 for which, _ in judge.pair.truths])
    most = many * judge.nats(at[:, None]).max(axis=0)
    counts = np.where(first, most[first].max() >= SAME, most[~first].max() >= SAME)

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


def _evidence(judge: Judge, chosen: np.ndarray) -> np.ndarray:
    """(N,) nats for each truth against its strongest rival, which the judge knows from then on."""
    run = judge.pool.run.take(chosen)
    run = replace(run, begin=np.arange(run.episodes) * (run.steps * run.period + PAUSE))
    out = []
    for truth in judge.pair.truths:
        nats, rival = strongest(judge.pair, run, truth)
        judge.add(1 - truth[0], rival)
        out.append(nats)
    return np.array(out)


def _counts(pair: Pair, found: list[Choice]) -> np.ndarray:
    """(N,) which truths count: a hypothesis that contains the other one loses nowhere where that one is true.

    Raises UsageError where none does.
    """
    most = np.max([choice.nats for choice in found], axis=0)
    owners = np.array([which for which, _ in pair.truths])
    lost = np.array([most[owners == which].max() >= SAME for which in (0, 1)])
    if not lost.any():
        raise UsageError(
            f"within the limits of the robot no commands tell {pair.terms[0].key} from {pair.terms[1].key}:"
            f" {most.max():.2g} nats at most",
            expected="effects that move the robot in different ways",
            do=_by_hand(pair.terms),
        )
    return lost[owners]


def _by_hand(terms: tuple[Term, Term]) -> str:
    said = [one.effect.separate_by for one in terms if one.effect.separate_by]
    return f"to separate them, {said[0]}" if said else "measure them by hand"


def _settings(robot: Robot) -> np.ndarray:
    """(M, K) settings to choose among: those that the commands for a diagnosis alternate between."""
    count = int(np.lcm.reduce([max(len(s.trial), 1) for s in robot.file.settings] or [1]))
    return np.unique(trial_settings(robot, count), axis=0)


def _usual(robot: Robot, limits: Limits, steps: int, many: int, seed: int) -> Pool:
    """The excitation of a usual diagnosis, begun at rest."""
    made = excitation(robot, seed=seed, name="diagnose", episodes=many, steps=steps, reach=REACH)
    kinds = robot.file.excitation.kinds
    run = Run(
        np.array([limits.keep(a, reset_pose(robot), 1.0 / robot.rate) for a in made.actions]),
        inputs=made.inputs,
        settings=trial_settings(robot, many),
        period=1.0 / robot.rate,
    )
    return Pool(tuple(f"usual {kinds[e % len(kinds)]}" for e in range(many)), run)
