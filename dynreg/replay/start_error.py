"""The error of the measured states that windows start from, taken out of residuals.

A window is replayed from a measured state, and that state has the sensors' noise. Half a second later a joint that
started 5 mrad/s too fast is 2 mrad too far: often more than anything that parameters change. Worse, it biases them: a
joint that rests, replayed from a speed that is noise, is best kept at rest by a friction that it does not have.

So a start state is fitted in each window, within its noise. Residuals are linear in errors so small, and what the most
likely errors explain is projected out of residuals, and by that of slopes, which are differences of residuals (variable
projection, Golub and Pereyra 1973, with a prior). Whitening by the covariance of residuals and start errors would keep
up to a third more of what they tell. But it trusts that linearity, and dry friction at rest is not linear in a start
speed. Of an arm's joint with a damping of 0.8, one robot: 0.7925 +- 0.0028 by whitening, 0.7957 +- 0.0037 by
projection, and 0.794 +- 0.010 by projection from better starts (`neighbours/make.py`). Whitening from better starts was
not tried.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.replay.samples import correlation_time
from dynreg.replay.windows import Replayer
from dynreg.sim.robot import Robot

# The noise of residuals is that of what start errors leave, and tells these. Of a simulator that is the robot, it still
# halves in the third round and stands after six (panda and husky of bench_first_hour, seeds 2 and 3): three believe the
# measured start states somewhat more than the end would. All figures were measured with three.
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class StartErrors:
    """What errors of the start states do to the residuals of W' windows.

    channels : (C,) those of the start state that may be wrong. slopes : (W', F, C) change of a window's F = T * S'
    residuals with each of them, of one standard deviation of its noise. weight : (F,) one over the variance of a
    residual's own noise. covariance : (W', C, C) of the start errors, where residuals are known. fitted : (W',) how
    many start states the residuals tell.
    """

    channels: np.ndarray
    slopes: np.ndarray
    weight: np.ndarray
    covariance: np.ndarray
    fitted: np.ndarray

    def told(self, residual: np.ndarray) -> np.ndarray:
        """(W', C) the most likely errors of the start states, in standard deviations, by residuals (W', T, S')."""
        flat = np.nan_to_num(residual).reshape(len(residual), -1) * self.weight
        return np.einsum("wcd,wfd,wf->wc", self.covariance, self.slopes, flat, optimize=True)

    def removed(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (n, W', T, S') without what the start states explain; NaN where they were."""
        flat = residuals.reshape(*residuals.shape[:2], -1)
        out = np.empty_like(flat)
        for w, (slopes, covariance) in enumerate(zip(self.slopes, self.covariance, strict=True)):
            error = (np.nan_to_num(flat[:, w]) * self.weight) @ slopes @ covariance
            out[:, w] = flat[:, w] - error @ slopes.T
        return out.reshape(residuals.shape)


@dataclass(frozen=True, eq=False)
class StartSlopes:
    """The channels (C,) and slopes (W', F, C) of `StartErrors`; C is 0 where the measured start states are believed.

    noise : (S',) standard deviation of each channel's residuals by its stated noise alone.
    """

    channels: np.ndarray
    slopes: np.ndarray
    noise: np.ndarray

    def errors(self, residual: np.ndarray) -> StartErrors:
        """Start errors, as far as residuals (W', T, S') of a simulator tell them.

        Where the simulator is far from the robot, its residuals are taken for noise, and start states are believed.
        """
        known, steps = np.isfinite(residual), residual.shape[1]
        many, found = self.slopes.shape[2], None
        left = residual
        for _ in range(ROUNDS):
            weight = np.tile(1.0 / _variance(left, self.noise), steps)
            covariance, fitted = np.empty((len(residual), many, many)), np.empty(len(residual))
            for w, slopes in enumerate(self.slopes):
                told = slopes.T @ (slopes * (weight * known[w].ravel())[:, None])
                covariance[w] = np.linalg.inv(told + np.eye(many))
                fitted[w] = np.trace(covariance[w] @ told)
            found = StartErrors(self.channels, self.slopes, weight, covariance, fitted)
            (left,) = found.removed(residual[None])
        return found


def believed(residual: np.ndarray) -> StartSlopes:
    """No errors in the start states of windows with residuals (W', T, S')."""
    nothing = np.zeros((len(residual), residual[0].size, 0))
    return StartSlopes(np.zeros(0, dtype=int), nothing, np.zeros(residual.shape[2]))


def noisy_channels(robot: Robot) -> np.ndarray:
    """(C,) the channels whose noise is stated: their start may be wrong, and costs a replay to know what that does."""
    return np.flatnonzero(robot.sensor_noise > 0)


def start_slopes(
    replayer: Replayer,
    values: np.ndarray,
    chosen: np.ndarray,
    residual: np.ndarray,
    initial: np.ndarray | None = None,
) -> StartSlopes:
    """Of the chosen windows, which a simulator (P,) replays with residuals (W', T, S').

    initial : (W', S) where they start, None for where it was measured. By differences of one standard deviation, a
    replay a channel that was measured. Of planar bases, the noise is that of a single row, though theirs may be the
    mean of some; the velocities that they are begun with are believed.
    """
    sensors, noisy = replayer.robot.sensor_noise, noisy_channels(replayer.robot)
    initial = replayer.windows.run.initial[chosen] if initial is None else initial
    channels = noisy[np.isfinite(initial[:, noisy]).any(axis=0)]
    if not len(channels):
        return believed(residual)
    moved = np.repeat(initial[None], len(channels), axis=0)
    moved[np.arange(len(channels)), :, channels] += sensors[channels, None]
    change = np.nan_to_num(replayer.residuals_from(values, chosen, moved) - residual).astype(np.float32)
    slopes = np.moveaxis(change.reshape(len(channels), len(chosen), -1), 0, 2)
    return StartSlopes(channels, np.ascontiguousarray(slopes), replayer.residual_noise)


def _variance(residual: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(S',) variance of the residuals (W', T, S') of each channel, times the samples that go into an independent one.

    Never below that of its stated noise (S',).
    """
    out = np.empty(residual.shape[2])
    for c in range(len(out)):
        series = [x[np.isfinite(x)] for x in residual[..., c]]
        # about zero: an offset stays alike through all of a window
        times = [correlation_time(x, mean=0.0) for x in series if np.any(x)]
        square = np.concatenate([np.zeros(1), *series]) ** 2
        out[c] = np.median(times or [1.0]) * square.sum() / max(len(square) - 1, 1)
    return np.maximum(out, np.maximum(noise**2, 1e-30))
