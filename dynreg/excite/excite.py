"""Excite: commands within the robot's limits that drive two hypotheses apart."""

from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import RobotError, UsageError
from dynreg.excite.candidates import Pool
from dynreg.excite.choose import SAME, Search
from dynreg.excite.limits import Limits
from dynreg.excite.playing import played
from dynreg.excite.separate import Pair
from dynreg.progress import Progress
from dynreg.sim.effects import Term, one_group, term
from dynreg.sim.robot import Robot

SHORT = 2.5  # s of an episode, and of the longest ones:
LONG = 10.0
EPISODES = 4  # at least: a diagnosis fits, selects and tests by different ones
FEWEST = 20  # commands of an episode
ROUNDS = 3
SECONDS = 10.0  # in all, unless asked for more: four episodes of the short kind


@dataclass(frozen=True, eq=False)
class Chosen:
    """Episodes that were chosen, and the evidence [nats] to expect of them in the worst case that counts.

    reached : (E, 2, S) lowest and highest states to expect. usual : the evidence of the usual excitation as long as
    this; None where it was not computed. counts : (N,) which truths of the pair count.
    """

    between: tuple[str, str]
    pair: Pair
    limits: Limits
    pool: Pool
    reached: np.ndarray
    nats: float
    usual: float | None
    counts: np.ndarray

    @property
    def recording(self) -> Recording:
        """The commands as a log without states: see `played`."""
        names = [f"excite_{e}" for e in range(self.pool.run.episodes)]
        source = {"between": list(self.between), "seed": self.pair.seed, "patterns": list(self.pool.names)}
        return played(self.pair.robot, self.pool.run, names, source)


def excite(
    robot: Robot,
    between: tuple[str, str],
    *,
    seconds: float,
    seed: int,
    rounds: int = ROUNDS,
    progress: Progress | None = None,
) -> Chosen:
    """Commands of `seconds` that tell the effects `between` apart, and the evidence to expect of them.

    Patterns of several reaches and speeds are tried, with the `trial` settings of robot.toml. Either effect is taken
    for true, at medium size and with either sign, and the other fitted to it: what counts is the evidence in the worst
    of these cases, those left out that nothing tells (the other effect contains this one, or it changes nothing).
    rounds : of choosing episodes, each against the rivals that the last one left.

    Raises UsageError where no commands separate the two (they are of one exact group, or move the robot alike),
    where an effect cannot act on the robot, or where `seconds` are too few; RobotError for a robot without commands
    or without a fixed command rate, that rests outside its limits, or whose replays are too short.
    """
    pair = Pair(robot, _terms(robot, between), seed)
    limits = Limits.of(robot)
    lengths = _lengths(robot, seconds)
    report = progress or (lambda *_: None)
    total, searches = len(lengths) * (rounds + 1) + 1, []
    for number, (steps, many) in enumerate(lengths):
        report("excite", number * (rounds + 1), total)
        search = Search.of(pair, limits, steps, many)
        searches.append(search)
        if search.usual is not None:
            search.rate(search.usual)
        for turn in range(rounds):
            report("excite", number * (rounds + 1) + turn + 1, total)
            chosen = search.choose()
            if chosen in search.rated:
                break
            search.rate(chosen)
    search, chosen, counts = _settled(pair, searches)
    report("excite", total, total)
    judge, at = search.judge, np.array(chosen)
    nats, usual = (
        None if one is None else float(search.rated[one][counts].min()) for one in (chosen, search.usual)
    )
    return Chosen(between, pair, limits, judge.pool.take(at), judge.reached[at], nats, usual, counts)


def _settled(pair: Pair, searches: list[Search]) -> tuple[Search, tuple[int, ...], np.ndarray]:
    """The best choice once all rivals are known, its search, and which truths (N,) count.

    What was rated early met few rivals: the best is rated again until it stays the best.
    """
    again = {(number, list(search.rated)[-1]) for number, search in enumerate(searches) if search.rated}
    while True:
        counts = _counts(pair, [nats for search in searches for nats in search.rated.values()])
        number, chosen = max(
            ((number, chosen) for number, search in enumerate(searches) for chosen in search.rated),
            key=lambda one: searches[one[0]].rated[one[1]][counts].min(),
        )
        search = searches[number]
        todo = {chosen, search.usual} - {None}
        todo = sorted(one for one in todo if (number, one) not in again)
        if not todo:
            return search, chosen, counts
        for one in todo:
            search.rate(one)
            again.add((number, one))


def _terms(robot: Robot, between: tuple[str, str]) -> tuple[Term, Term]:
    """The two terms; UsageError where they cannot act on the robot, or no commands tell them apart."""
    if not robot.actions:
        raise RobotError(
            f"robot {robot.name!r} takes no commands", expected="[[actions]]", do="excite it by hand"
        )
    first, second = term(between[0]), term(between[1])
    for one in (first, second):
        unknown = sorted(set(one.joints) - {*robot.joints})
        reason = one.effect.why_not(robot) or (f"no action drives {unknown[0]!r}" if unknown else None)
        if reason:
            raise UsageError(
                f"effect {one.key!r} on robot {robot.name!r}: {reason}",
                expected="two effects that can act there",
                do=f"see `dynreg effects {robot.name}`",
            )
    if first.key == second.key or one_group(robot, first, second):
        raise UsageError(
            f"no commands tell {first.key} from {second.key}: both make the same motions",
            expected="two effects that commands can tell apart",
            do=_by_hand((first, second)),
        )
    return first, second


def _lengths(robot: Robot, seconds: float) -> list[tuple[int, int]]:
    """(commands, episodes) to try: short episodes, and long ones for what changes slowly."""
    longest = robot.file.replay.horizon or LONG  # a diagnosis sees no more at once
    if round(longest * robot.rate) < FEWEST:
        raise RobotError(
            f"a replay of robot {robot.name!r} holds {longest * robot.rate:.3g} commands ({longest:g} s at"
            f" {robot.rate:g} Hz)",
            expected=f"at least {FEWEST}, as an episode needs",
            do=f"set horizon = {FEWEST / robot.rate:g} or more in [replay] of robot.toml",
        )
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


def _counts(pair: Pair, found: list[np.ndarray]) -> np.ndarray:
    """(N,) which truths count: not those of an effect that the other one contains, or that change nothing.

    Raises UsageError where none does.
    """
    most = np.max(found, axis=0)
    if not (most >= SAME).any():
        raise UsageError(
            f"within its limits and tolerances robot {pair.robot.name!r} does not tell {pair.terms[0].key} from"
            f" {pair.terms[1].key} by any commands that were tried ({most.max():.2g} nats at most)",
            expected="two effects for which its own parameters cannot make up",
            do=_by_hand(pair.terms),
        )
    return most >= SAME


def _by_hand(terms: tuple[Term, Term]) -> str:
    said = next(filter(None, (one.effect.separate_by_at(one.at) for one in terms)), None)
    return f"to separate them, {said}" if said else "measure them by hand"
