"""The residual after the search against the noise floor, which no simulator can explain; the verdict from it."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.plans.plan import State
from dynreg.diagnose.pose import placed
from dynreg.diagnose.repeatability import Repeatability, repeatability, whiteness
from dynreg.diagnose.score import Naming
from dynreg.evidence.lockstep import Search
from dynreg.evidence.model import Model
from dynreg.evidence.point import Point
from dynreg.replay.residual import scaled
from dynreg.replay.velocity import pose_columns
from dynreg.replay.windows import Windows, standing
from dynreg.rng import stream
from dynreg.sim.effects import one_group
from dynreg.sim.robot import Robot

TINY = 1e-12  # lower bound of mean squares and noise, for logarithms and divisions
Verdict = Literal["named", "ambiguous", "partly_explained", "unknown", "none"]
WHITE = 0.01  # p-value of the whiteness test, above which a residual counts as white noise
STARTS = 8  # other starts of each window within their noise; of 16 windows they tell its size to a tenth
EXPLAINED = 1.5  # ratio of residual to noise floor up to which everything counts as explained: by contract


@dataclass(frozen=True)
class Noise:
    """The residual of one channel (`left`) and its noise floor, which no simulator can explain; 1 sigma in `unit`.

    left : with contacts, the geometric mean over the windows. basis : what the floor comes from. ratio : left / floor.
    white : whether the residual looks like white noise; None if unknown.
    """

    channel: str
    unit: str
    left: float
    floor: float
    basis: Literal["repeatability", "stated_noise"]
    ratio: float
    white: bool | None = None


@dataclass(frozen=True)
class Evidence:
    """The residual of the extended simulator on the fit and select parts, and the noise floor of each channel.

    noise : of the channel with the largest ratio. repeats : of every channel, by name.
    """

    noise: Noise
    repeats: dict[str, Repeatability]

    @classmethod
    def of(cls, found: State, recording: Recording) -> Search["Evidence"]:
        """Compute the residual on the fit and select parts, and the repeatability on the whole recording."""
        model, data = found.model, found.data
        robot, chosen = model.robot, data.parts.chosen
        repeats = {r.channel: r for r in repeatability(robot, recording)}
        # of whole rollouts, like the repeatability
        (left,) = yield from model.fine.residuals([found.current], data.whole.sample(chosen))
        windows = data.windows.take(chosen)
        rough = model.accuracy.fine
        started = yield from start_noise(model.fine, found.current, windows, rough)
        begun = np.hypot(begin_noise(robot, windows), started)
        rows = []
        for c, column in enumerate(data.use):
            spread = data.windows.spread[column]
            known = repeats[robot.channels[column]]
            stated = max(float(np.hypot(known.stated, begun[column])), TINY)
            floor = known.spread if known.spread else stated
            size = float(remaining(left[..., c], rough) * spread)
            chance = whiteness(left[..., c])
            rows.append(
                Noise(
                    channel=robot.channels[column],
                    unit=robot.file.channels[column].unit,
                    left=size,
                    floor=float(floor),
                    basis="repeatability" if known.spread else "stated_noise",
                    ratio=size / float(floor),
                    white=None if chance is None else chance > WHITE,
                )
            )
        return cls(max(rows, key=lambda n: n.ratio), repeats)


def begin_noise(robot: Robot, windows: Windows) -> np.ndarray:
    """(S,) root mean square error of each channel from the noise of the initial pose, in the channel's unit.

    An error of a planar base's initial heading stays, and its position error grows with the distance. 0 for all other
    channels and robots.
    """
    out = np.zeros(len(robot.channels))
    columns = pose_columns(robot)
    if columns is None:
        return out
    still = standing(robot, windows.run.actions, windows.measured, windows.run.before)
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
    off = stream(0, "start noise").standard_normal((1 + STARTS, len(measured), initial.shape[1]))
    off[0] = 0.0
    begun = initial[measured] + off * robot.sensor_noise
    every = np.tile(measured, 1 + STARTS)
    run = replace(windows.run.take(every), initial=begun.reshape(len(every), -1))
    (states,) = yield from model.states([point], run)
    states = states.reshape(1 + STARTS, len(measured), *states.shape[1:])[..., 1:, :]
    apart = scaled(states[1:], states[0], windows.spread).reshape(-1, *states.shape[2:])
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
    robot: Robot, evidence: Evidence, rounds: tuple[Naming, ...], accepted: int, *, outside: bool = False
) -> Verdict:
    """The verdict: "named" or "ambiguous" if the residual reaches the noise floor, else "partly_explained"; without a
    cause "none" or "unknown".

    Without repeated runs the floor is the stated noise; a white residual then counts as explained, too.
    outside : whether none of the known causes looks like the log: one cause alone then explains part of it at most.
    (A log with several causes looks like none of them.)
    """
    explained = evidence.noise.ratio <= EXPLAINED
    if evidence.noise.basis == "stated_noise" and evidence.noise.white:
        explained = True
    if accepted == 0:
        return "none" if explained else "unknown"
    if not explained or (outside and accepted == 1):
        return "partly_explained"
    return "ambiguous" if rivals(robot, rounds[0]) else "named"


def rivals(robot: Robot, naming: Naming) -> list[str]:
    """Keys of the equivalents of a round's cause that do not belong to its exact group."""
    chosen = naming.chosen.point.hypothesis.terms[-1]
    others = [s.point.hypothesis.terms[-1] for s in naming.equivalent]
    return [t.key for t in others if not one_group(robot, chosen, t)]
