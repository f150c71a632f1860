"""The residual after the search against the noise floor, which no simulator can explain; the verdict from it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.doubts import Doubt
from dynreg.diagnose.kinds import Verdict
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import placed
from dynreg.diagnose.score import Naming
from dynreg.diagnose.starts import changes, from_other_starts
from dynreg.diagnose.tail import exceeded
from dynreg.evidence.data import Data
from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.repeatability import Repeatability, repeatability, whiteness
from dynreg.replay.velocity import pose_columns
from dynreg.replay.windows import Windows, standing
from dynreg.sim.effects import Term, one_group
from dynreg.sim.robot import Robot

TINY = 1e-12  # lower bound of mean squares and noise, for logarithms and divisions
WHITE = 0.01  # p-value of the whiteness test, above which a residual counts as white noise
EXPLAINED = 1.5  # ratio of residual to noise floor up to which everything counts as explained: by contract
# Chance that everything is explained and yet all channels together are said to leave more. Robots with nothing hidden
# should be told so in 19 of 20 cases: by contract.
CHANCE = 0.05


@dataclass(frozen=True)
class Noise:
    """The residual of one channel (`left`) and its noise floor, which no simulator can explain; 1 sigma in `unit`.

    left : with contacts, the geometric mean over the windows. basis : what the floor comes from. floor : 0 where no run
    was repeated and no noise is stated. ratio : left / floor; None where the floor is 0.
    limit : the ratio up to which all counts as explained, with the sampling error of both.
    white : whether the residual looks like white noise; None if unknown.
    """

    channel: str
    unit: str
    left: float
    floor: float
    basis: Literal["repeatability", "stated_noise"]
    ratio: float | None
    limit: float = EXPLAINED
    white: bool | None = None

    @property
    def over(self) -> float:
        """The ratio over its limit; 0 where there is none."""
        return 0.0 if self.ratio is None else self.ratio / self.limit

    @property
    def explained(self) -> bool:
        """Whether it is within its limit or, without repeated runs, white."""
        within = self.ratio is not None and self.over <= 1
        return within or (self.basis == "stated_noise" and bool(self.white))


@dataclass(frozen=True)
class Left:
    """What a simulator leaves of one channel beside its stated noise (0: none is); 1 sigma in the channel's unit.

    samples : independent ones in the residual. white : as in `Noise`.
    """

    column: int
    size: float
    stated: float
    samples: float
    white: bool | None


@dataclass(frozen=True)
class Evidence:
    """The residual of the extended simulator on the fit and select parts, and the noise floor of each channel.

    noise : of the channel that says most against the simulator; see `worst`. repeats : of every channel, by name.
    usual : whether simulated robots without an effect leave as much of their stated noise; None where none were
    simulated. zeros : the most that positions of an episode were shifted by, by channel, where this alone explains the
    error; see `diagnose.zeros`.
    """

    noise: Noise
    repeats: dict[str, Repeatability]
    usual: bool | None = None
    zeros: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, found: State, recording: Recording, usual: Sequence[float] = ()) -> Search["Evidence"]:
        """Compute the residual on the fit and select parts, and the repeatability on what may be read of the recording.

        usual : `most_left` of simulated robots without an effect.
        """
        robot = found.model.robot
        repeats = {r.channel: r for r in repeatability(robot, recording)}
        left = yield from lefts(found.model, found.current, found.data)
        rows = [noise_of(robot, one, repeats[robot.channels[one.column]], len(left)) for one in left]
        as_usual = most_left(left) <= exceeded(usual, CHANCE) if usual else None
        return cls(worst(rows), repeats, as_usual)

    @property
    def explained(self) -> bool:
        """Whether nothing is left to explain.

        Either the residual of every channel is within what repeated runs differ by, or without repeated runs within the
        stated noise, or white; or simulated robots without an effect leave as much.
        """
        return self.noise.explained or bool(self.usual)


def worst(rows: Sequence[Noise]) -> Noise:
    """The channel that says most against a simulator: white noise on another one does not explain it."""
    return max(rows, key=lambda noise: (not noise.explained, noise.over))


def noise_of(robot: Robot, left: Left, known: Repeatability, channels: int) -> Noise:
    """What is left of a channel against the difference of repeated runs, or against its stated noise.

    The limit is `EXPLAINED` times what chance may add: the quantile of Fisher's F distribution, of the ratio of two
    variances with the independent samples of both, such that one of all `channels` exceeds it with `CHANCE`.
    """
    from scipy.stats import chi2, f

    floor = float(known.spread if known.spread else left.stated)
    own, each = max(left.samples, 1.0), (1.0 - CHANCE) ** (1.0 / channels)
    more = f.ppf(each, own, max(known.independent, 1.0)) if known.spread else chi2.ppf(each, own) / own
    return Noise(
        channel=robot.channels[left.column],
        unit=robot.file.channels[left.column].unit,
        left=left.size,
        floor=floor,
        basis="repeatability" if known.spread else "stated_noise",
        ratio=left.size / floor if floor > 0 else None,
        limit=float(EXPLAINED * np.sqrt(max(more, 1.0))),
        white=left.white,
    )


def lefts(model: Model, point: Point, data: Data) -> Search[list[Left]]:
    """What a simulator leaves of every weighted channel on the fit and select parts."""
    robot, chosen = model.robot, data.parts.chosen
    # of whole rollouts, like the repeatability
    (residual,) = yield from model.fine.residuals([point], data.whole.sample(chosen))
    windows = data.windows.take(chosen)
    rough = model.accuracy.fine
    started = yield from start_noise(model.fine, point, windows, rough)
    noise = np.hypot(data.noise, np.hypot(begin_noise(robot, windows), started))
    samples = np.nansum(data.whole.effective(residual), axis=0)
    out = []
    for c, column in enumerate(data.use):
        chance = whiteness(residual[..., c])
        out.append(
            Left(
                column=int(column),
                size=float(remaining(residual[..., c], rough) * data.windows.spread[column]),
                stated=float(noise[column]),
                samples=float(samples[c]),
                white=None if chance is None else chance > WHITE,
            )
        )
    return out


def most_left(left: Sequence[Left]) -> float:
    """The largest ratio of what is left to the stated noise, of all channels."""
    return max(one.size / max(one.stated, TINY) for one in left)


def begin_noise(robot: Robot, windows: Windows) -> np.ndarray:
    """(S,) root mean square error of each channel from the noise of the initial pose, in the channel's unit.

    An error of a planar base's initial heading stays, and its position error grows with the distance. 0 for all other
    channels and robots.
    """
    out = np.zeros(len(robot.channels))
    columns = pose_columns(robot)
    if columns is None:
        return out
    still = standing(robot, windows.run.actions, windows.measured, windows.run.rolling)
    known = np.isfinite(windows.measured[..., columns]).all(axis=2)
    rows = np.array([max(k[:many].sum(), 1) for k, many in zip(known, still, strict=True)])
    noise = (
        robot.sensor_noise[columns] / np.sqrt(rows)[:, None]
    )  # the start at standstill is a mean of its rows
    way = windows.measured[..., columns[:2]] - windows.run.initial[:, None, columns[:2]]
    squares = np.repeat(noise[:, None] ** 2, way.shape[1], axis=1)
    squares[..., :2] += (noise[:, None, 2:] * way[..., ::-1]) ** 2
    squares[~np.isfinite(windows.measured[..., columns])] = np.nan
    for column, one in zip(columns, np.moveaxis(squares[:, 1:], -1, 0), strict=True):
        out[column] = np.sqrt(np.nanmean(one)) if np.isfinite(one).any() else 0.0
    return out


def start_noise(model: Model, point: Point, windows: Windows, rough: bool) -> Search[np.ndarray]:
    """(S,) root mean square error of each channel from the noise of a floating base's measured start, in its unit.

    By how much rollouts of the point change from starts within that noise: where the feet do not hold a base, it never
    forgets how it set out. 0 where bases begin in their settled pose; see `pose.placed`. rough : as in `remaining`.
    """
    robot, initial = model.robot, windows.run.initial
    own = placed(robot, initial)
    if not own.any():
        return np.zeros(len(robot.channels))
    measured = np.flatnonzero(own)  # the others begin settled, without that noise
    run = from_other_starts(windows.run, measured, robot.sensor_noise)
    (states,) = yield from model.states([point], run)
    apart = changes(states, windows.spread)
    apart = apart.reshape(-1, *apart.shape[2:])
    sizes = [remaining(apart[..., c], rough) for c in range(len(robot.channels))]
    return np.array(sizes) * windows.spread * np.sqrt(own.mean())


def remaining(residual: np.ndarray, rough: bool) -> float:
    """Root mean square of a residual (W, T), in its unit.

    With contacts (`rough`) it is the geometric mean of the windows' root mean squares, as the likelihood sums
    logarithms: one window in which a foot slips too late, as in the true simulator, must not dominate the others. The
    price: a residual of k times the noise in half of the windows counts as sqrt(k).
    """
    if not rough:
        return float(np.sqrt(np.nanmean(residual**2)))
    measured = np.isfinite(residual).any(axis=1)
    squares = np.nanmean(residual[measured] ** 2, axis=1)
    return float(np.sqrt(np.exp(np.log(np.maximum(squares, TINY)).mean())))


def verdict_of(
    robot: Robot,
    evidence: Evidence,
    rounds: tuple[Naming, ...],
    accepted: int,
    doubted: Sequence[Doubt] = (),
) -> Verdict:
    """The verdict: "named" or "ambiguous" if nothing is left to explain and nothing speaks against the causes, else
    "partly_explained"; without a cause "none" or "unknown".
    """
    if accepted == 0:
        return "none" if evidence.explained else "unknown"
    if not evidence.explained or doubted:
        return "partly_explained"
    return "ambiguous" if rivals(robot, rounds[0]) else "named"


def rivals(robot: Robot, naming: Naming) -> list[str]:
    """Keys of what is as good as a round's cause and does not belong to its exact group."""
    others = [s.term for s in naming.as_good]
    return [t.key for t in others if not one_group(robot, naming.chosen.term, t)]


def not_told_apart(robot: Robot, naming: Naming, without: Sequence[str] = ()) -> list[str]:
    """Keys of what explains the data as well as a round's cause: its rivals, and those of its exact group that are as
    good or were not fitted. Where the group is exact but for how a log begins, the data do tell some of it apart.

    without : as in `group_of`.
    """
    less = {s.term.key for s in naming.ranking} - {s.term.key for s in naming.as_good}
    group = group_of(robot, naming.chosen.term, (*without, *naming.small))
    return [*rivals(robot, naming), *(key for key in group if key not in less)]


def group_of(robot: Robot, term: Term, without: Sequence[str] = ()) -> list[str]:
    """Keys of the other terms of a term's exact group that can act on the robot: no commands tell them from it.

    Whatever they scored, looked for or not. without : ids of effects that cannot be meant.
    """
    every = single_terms(robot, without=tuple(without))
    return [t.key for t in every if t.key != term.key and one_group(robot, term, t)]
