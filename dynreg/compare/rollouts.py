"""Held-out error of simulators: rollouts of several lengths from measured states, on the same windows for all."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.progress import Progress
from dynreg.replay.cut import unbroken, usual_horizon
from dynreg.replay.holes import holes
from dynreg.replay.judged import Traced, ratio, traced
from dynreg.replay.parts import names, parts
from dynreg.replay.residual import by_weight, scaled
from dynreg.replay.rows import rows_of
from dynreg.replay.windows import Windows
from dynreg.sim.config import SimConfig, terms_of
from dynreg.sim.engines import rollout
from dynreg.sim.robot import Robot

HORIZONS = (0.1, 0.5, 1.0)  # s, beside the longest
MOST = 200  # rollouts of a horizon, evenly over the recording: more tell hardly more
EPISODES = 4  # from which on each is a block by itself: fewer tell nothing of how runs differ
# Stretches of time that stand for episodes where these are fewer: each as long as ten allow, as errors of neighbouring
# rollouts are alike; and enough for an interval.
STRETCHES = 10
ROUNDING = 1e-6  # smaller relative differences of two errors are rounding
CHANNELS = 4  # most channels of the traces

Seen = Callable[
    [str, float, float], bool
]  # whether a simulator has seen rows of an episode, from second to second


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of n simulators in the rollouts of one horizon [s], by block: an episode, or a stretch of time in one.

    total : (n, B, C + 1) sums of absolute errors, in each channel's unit; the last column is of all channels, in units
    of their spread and by their weight; see `residual.by_weight`. many : (B, C + 1) what was summed. channels : (C,)
    columns in the robot's. scored : (C,) whether the last column counts them. noise : (C + 1,) the channels' stated
    noise, and that of all together. within : how many runs the blocks are stretches of; None where they are episodes.
    """

    seconds: float
    rollouts: int
    whole: bool
    total: np.ndarray
    many: np.ndarray
    channels: np.ndarray
    scored: np.ndarray
    noise: np.ndarray
    within: int | None

    @property
    def mean(self) -> np.ndarray:
        """(n, C + 1) errors."""
        return self.total.sum(axis=1) / np.maximum(self.many.sum(axis=0), 1)

    def bounds(self, one: int) -> np.ndarray | None:
        """(2, C + 1) the 90 % interval of a simulator's errors over the blocks; None where these are too few."""
        return ratio(self.many, self.total[one])

    def ratio_to(self, one: int, other: int = 0) -> np.ndarray | None:
        """(2, C + 1) the 90 % interval of the ratio of one simulator's errors to another's, over the same blocks.

        None where the blocks are too few; NaN where the other has no error.
        """
        return ratio(self.total[other], self.total[one])

    def tie(self, one: int, other: int) -> tuple[bool | None, ...]:
        """(C + 1,) whether two simulators cannot be told apart; None where nothing tells.

        They cannot where their difference is rounding, or less than the sensors' stated noise (all channels together:
        less than that of all together), or where the interval of their ratio holds 1. Without an interval a larger
        difference may be chance or not.
        """
        apart = np.abs(self.mean[one] - self.mean[other])
        small = (apart <= ROUNDING * np.maximum(self.mean[one], self.mean[other])) | (apart < self.noise)
        left = self.ratio_to(one, other)
        if left is None:
            return tuple(True if tie else None for tie in small)
        low, high = left
        return tuple(bool(tie) for tie in small | ((low <= 1.0) & (high >= 1.0)))


@dataclass(frozen=True, eq=False)
class Scored:
    """Errors by horizon, the shortest first; episodes tested, windows left out; traces of the longest rollouts.

    too_long : horizons [s] at which nothing was held out.
    """

    errors: tuple[Errors, ...]
    too_long: tuple[float, ...]
    episodes: tuple[str, ...]
    left_out: tuple[str, ...]
    traces: tuple[Traced, ...]


def score(
    robot: Robot,
    recording: Recording,
    simulators: Mapping[str, tuple[Robot, SimConfig]],
    seen: Sequence[Seen],
    hold_out: str | None = None,
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> Scored:
    """Held-out errors of simulators (by name, each with its robot) at every horizon that the recording allows.

    Windows of which a simulator has seen a row are left out, for all of them. Horizons at which nothing was held out
    are left out, too. hold_out : the only part to test on; see `replay.parts`. Raises UsageError where nothing is held
    out from all, or a simulator is of a robot with other channels; LogError where the recording cannot be replayed.
    """
    for name, (owner, _) in simulators.items():
        _require_alike(robot, name, owner)
    every, lost = _horizons(robot, recording), holes(robot, recording)
    cuts = [unbroken(robot, recording, seconds, lost) for seconds in every]
    left = [_unseen(robot, recording, cut, seen) for cut in cuts]
    held = [_held_out(recording, cuts[0], hold_out, left[0])]
    for cut, mask in zip(cuts[1:], left[1:], strict=True):
        try:
            held.append(_held_out(recording, cut, hold_out, mask))
        except UsageError:  # the shortest could be parted, these are too few
            held.append(np.zeros(len(cut), dtype=bool))
    while held and not held[-1].any():  # of a diagnosis of short windows, nothing longer may be held out
        held.pop()
    _require_some(held, hold_out)
    lengths, cuts, left, allowed = every[: len(held)], cuts[: len(held)], left[: len(held)], held[-1]
    tested = {(recording.episodes[e].name) for e in cuts[-1].episode[allowed]}
    out, states = [], None
    for number, (cut, mask) in enumerate(zip(cuts, left, strict=True)):
        longest = number == len(cuts) - 1
        inside = allowed if longest else mask & _inside(cut, cuts[-1].take(np.flatnonzero(allowed)))
        chosen = _thinned(np.flatnonzero(inside))
        if not len(chosen):
            continue
        states = _states(simulators, cut, chosen, threads)
        out.append(_errors(robot, cut, chosen, states, lengths[number], longest))
        if progress:
            progress("replay", number + 1, len(cuts))
    drawn = traced(robot, recording, cuts[-1], states, chosen, worst=0, channels=CHANNELS)
    return Scored(
        tuple(out),
        tuple(every[len(held) :]),
        tuple(e.name for e in recording.episodes if e.name in tested),
        names(recording, cuts[-1], ~left[-1]),
        tuple(drawn),
    )


def _horizons(robot: Robot, recording: Recording) -> list[float]:
    """[s] of the rollouts: the usual ones of at least two rows, and the longest."""
    period = rows_of(robot, recording).period
    most = min(max(e.duration for e in recording.episodes), usual_horizon(robot))
    return [h for h in HORIZONS if 2 * period <= h < 0.9 * most] + [most]


def _unseen(robot: Robot, recording: Recording, cut: Windows, seen: Sequence[Seen]) -> np.ndarray:
    """(W,) whether no simulator has seen a row of the window."""
    spans = rows_of(robot, recording).spans(cut.episode, cut.rows).tolist()
    pairs = zip(cut.episode, spans, strict=True)
    told = [(recording.episodes[e].name, begin, end) for e, (begin, end) in pairs]
    return np.array([not any(known(*span) for known in seen) for span in told], dtype=bool)


def _held_out(recording: Recording, cut: Windows, hold_out: str | None, left: np.ndarray) -> np.ndarray:
    return left if hold_out is None else left & parts(recording, cut, hold_out).test


def _require_some(held: list[np.ndarray], hold_out: str | None) -> None:
    """UsageError where nothing was held out from all simulators, at no horizon."""
    if not held:
        where = "of the recording" if hold_out is None else f"of hold-out {hold_out!r}"
        raise UsageError(
            f"every part {where} was seen by one of the simulators",
            expected="a part that none of them was fitted to or chosen by",
            do="compare on another recording, or run `dynreg query` and `dynreg diagnose` with the same --hold-out, of"
            " whole episodes where the robot stands on feet",
        )


def _inside(cut: Windows, outer: Windows) -> np.ndarray:
    """(W,) whether windows lie in one of the outer ones."""
    out = np.zeros(len(cut), dtype=bool)
    for episode, (first, stop) in zip(outer.episode, outer.rows, strict=True):
        out |= (cut.episode == episode) & (cut.rows[:, 0] >= first) & (cut.rows[:, 1] <= stop)
    return out


def _thinned(chosen: np.ndarray) -> np.ndarray:
    return chosen[np.unique(np.linspace(0, len(chosen) - 1, min(MOST, len(chosen))).round().astype(int))]


def _states(
    simulators: Mapping[str, tuple[Robot, SimConfig]], cut: Windows, chosen: np.ndarray, threads: int
) -> np.ndarray:
    """(n, W, T+1, S) what the simulators do in the chosen windows, without motor noise."""
    run = cut.run.take(chosen)
    out = []
    for owner, config in simulators.values():
        values = owner.space.from_dict(dict(config.values))[None]
        terms = terms_of(config, owner) if config.effects else None
        out.append(rollout(owner, values, run, threads=threads, terms=terms).states[0])
    return np.stack(out)


def _errors(
    robot: Robot, cut: Windows, chosen: np.ndarray, states: np.ndarray, seconds: float, whole: bool
) -> Errors:
    """Errors of states (n, W, T+1, S) in the chosen windows; see `residual.scaled` for simulators that diverge."""
    measured = cut.measured[chosen][:, 1:]
    use = np.flatnonzero(np.isfinite(measured).any(axis=(0, 1)))
    known = np.isfinite(measured[..., use])
    spread, weight = cut.spread[use], cut.weight[use]
    off = np.abs(scaled(states[..., 1:, use], measured[..., use], spread))
    each = np.where(known, off, 0.0).sum(axis=2)  # (n, W, C)
    rows = known.sum(axis=1)  # (W, C)
    share = weight / np.maximum(weight.sum(), 1e-12)
    together = (each * by_weight(measured[..., use], share)).sum(axis=2, keepdims=True)
    total = np.concatenate([each * spread, together], axis=2)
    many = np.concatenate([rows, (rows * (share > 0)).sum(axis=1, keepdims=True)], axis=1)
    blocks, within = _blocks(cut.episode[chosen], cut.rows[chosen])
    noise = robot.sensor_noise[use]
    member = (blocks[None] == np.unique(blocks)[:, None]).astype(float)
    return Errors(
        seconds,
        len(chosen),
        whole,
        np.einsum("bw,nwc->nbc", member, total),
        member @ many,
        use,
        share > 0,
        np.append(noise, (share * noise / spread).sum()),
        within,
    )


def _blocks(episode: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, int | None]:
    """(W,) the block of each rollout: its episode, or a stretch of time in it where episodes are few; and of how many.

    episode : (W,) numbers. rows : (W, 2) where rollouts lie in their episodes.
    """
    runs = np.unique(episode)
    if len(runs) >= EPISODES:
        return episode, None
    out, begin = np.zeros(len(episode), dtype=int), 0
    for number, run in enumerate(runs):
        each = (STRETCHES + len(runs) - 1 - number) // len(runs)
        own = np.flatnonzero(episode == run)
        own = own[np.argsort(rows[own, 0], kind="stable")]
        for stretch, some in enumerate(np.array_split(own, min(each, len(own)))):
            out[some] = begin + stretch
        begin += each
    return out, len(runs)


def _require_alike(robot: Robot, name: str, owner: Robot) -> None:
    told = (owner.channels, owner.actions, owner.inputs, owner.settings)
    if told != (robot.channels, robot.actions, robot.inputs, robot.settings):
        raise UsageError(
            f"simulator {name!r} is of robot {owner.name!r}, which has other channels than {robot.name!r}",
            expected="simulators with the channels, commands and settings of the recording's robot",
            do="name another; see `dynreg list --kind simulator`",
        )
