"""Data: a recording in windows and parts; a sample: which windows a fit looks at, and for how much each counts."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dynreg.replay.parts import Parts
from dynreg.replay.residual import by_weight, scaled
from dynreg.replay.samples import effective_samples
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot

# Half and twice name the same 16 of 21 (bench_constants). The fewer, the nearer to its nameplate a first fit stays, and
# the more a cause gains: 3234, 2777, 2363 nats.
BEFORE = 20.0  # independent samples of a rollout before anything is known of its residual
# A simulator that rests with the robot leaves nothing in a window, which without a floor would be infinitely likely:
# every other window would count for nothing. Sensors seldom resolve more than a thousandth of the motion; a joint with
# dry friction and two of twelve episodes at rest is fitted alike with 1e-6 to 1e-2.
UNSTATED = 1e-3  # of a channel's spread: 1 sigma where neither noise nor quantum is stated


@dataclass(frozen=True, eq=False)
class Data:
    """A robot's recording in windows and parts, with its scale: the unit of each channel, and its stated noise.

    windows : errors are in units of their spread. noise : (S,) 1 sigma of what no simulator can foresee of every
    channel, in its unit: its sensor's, or more where rollouts keep that of their starts; 0 where none is stated.
    segments : into how many stretches of time the residual of each window is cut, each with a variance of its own.
    apart : whether each window counts by its own correlation time; see `effective_samples`.
    """

    windows: Windows
    parts: Parts
    noise: np.ndarray
    segments: int = 1
    apart: bool = False

    @classmethod
    def of(
        cls,
        robot: Robot,
        windows: Windows,
        parts: Parts,
        segment: float | None = None,
        noise: np.ndarray | None = None,
    ) -> "Data":
        """Of a robot.

        segment : [s] of a rollout that share a variance, None for all of it. noise : by default that of the sensors.
        """
        rows = windows.measured.shape[1] - 1
        segments = 1 if segment is None else max(round(rows * windows.period / segment), 1)
        noise = robot.sensor_noise if noise is None else noise
        return cls(windows, parts, noise, segments, len(robot.actions) > 1)

    @cached_property
    def use(self) -> np.ndarray:
        """(C,) columns of the channels that count."""
        return np.flatnonzero(self.windows.weight > 0)

    @cached_property
    def spread(self) -> np.ndarray:
        """(C,) unit of their errors."""
        return self.windows.spread[self.use]

    @cached_property
    def floor(self) -> np.ndarray:
        """(C,) variance of their noise, in units of spread^2; that of `UNSTATED` where none is stated."""
        stated = self.noise[self.use]
        return np.where(stated > 0, stated / self.spread, UNSTATED) ** 2

    @property
    def fit(self) -> np.ndarray:
        """Numbers of the windows to fit."""
        return np.flatnonzero(self.parts.fit)

    @property
    def select(self) -> np.ndarray:
        """Numbers of the windows to select by."""
        return np.flatnonzero(self.parts.select)

    @property
    def train(self) -> Windows:
        """The windows that are not held out."""
        return self.windows.take(self.parts.train)

    @property
    def both(self) -> np.ndarray:
        """Numbers of the windows to fit, then of those to select by."""
        return np.concatenate([self.fit, self.select])

    @cached_property
    def whole(self) -> "Data":
        """The same with rollouts uncut."""
        return self if self.segments == 1 else replace(self, segments=1)

    def beginning(self, share: float) -> "Data":
        """The same, cut after this share of the longest window; shorter ones may stay whole."""
        steps = max(round(share * self.windows.run.steps), 1)
        return replace(self, windows=self.windows.until(steps), segments=max(round(share * self.segments), 1))

    def sample(self, chosen: np.ndarray) -> "Sample":
        """The windows `chosen` (numbers), before anything is known of what a simulator leaves in them."""
        shape = len(chosen) * self.segments, len(self.use)
        return Sample(self, chosen, np.full(shape, BEFORE / self.segments))

    def cut(self, rollouts: np.ndarray) -> np.ndarray:
        """(n, W, T, C) -> (n, W * segments, T / segments rounded up, C); NaN after the end."""
        if self.segments == 1:  # of most robots: nothing is copied
            return rollouts
        missing = -rollouts.shape[2] % self.segments
        padded = np.pad(rollouts, ((0, 0), (0, 0), (0, missing), (0, 0)), constant_values=np.nan)
        many, windows, rows, channels = padded.shape
        return padded.reshape(many, windows * self.segments, rows // self.segments, channels)

    def effective(self, residuals: np.ndarray) -> np.ndarray:
        """(W, C) independent samples in residuals (W, T, C); see `effective_samples`.

        Segments are too short to tell how long a residual stays alike: those of a rollout share its samples, each by
        the rows that were measured in it.
        """
        windows, rows, channels = residuals.shape
        rollouts = residuals.reshape(windows // self.segments, rows * self.segments, channels)
        samples = effective_samples(rollouts, apart=self.apart)
        known = np.isfinite(residuals).sum(axis=1).reshape(len(rollouts), self.segments, channels)
        share = known / np.maximum(known.sum(axis=1, keepdims=True), 1)
        return (share * samples[:, None]).reshape(windows, channels)

    def window_errors(self, states: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(W,) replay error of states (W, T+1, S) in windows, by channels' weight, in units of their spread."""
        measured = self.windows.measured[chosen][:, 1:, self.use]
        each = np.nansum(np.abs(scaled(states[:, 1:, self.use], measured, self.spread)), axis=1)
        each *= by_weight(measured, self.windows.weight[self.use])
        return each.sum(axis=1) / np.maximum(np.isfinite(measured).sum(axis=(1, 2)), 1)


@dataclass(frozen=True, eq=False)
class Sample:
    """What a fit looks at: windows of the data, and how many independent samples each of them holds.

    chosen : numbers of the windows. effective : (W, C); W is `data.segments` times their number, here and wherever
    residuals, their derivatives or mean squares are spoken of; a window's are in a row.
    """

    data: Data
    chosen: np.ndarray
    effective: np.ndarray = field(repr=False)

    @cached_property
    def measured(self) -> np.ndarray:
        """(W', T, C) of the windows, uncut, after the start."""
        return self.data.windows.measured[self.chosen][:, 1:, self.data.use]

    def reweighted(self, residual: np.ndarray) -> "Sample":
        """The same windows with the independent samples of a residual (W, T, C) in them."""
        return replace(self, effective=self.data.effective(residual))

    def take(self, count: int) -> "Sample":
        """The first windows alone, `count` of them."""
        return Sample(self.data, self.chosen[:count], self.effective[: count * self.data.segments])
