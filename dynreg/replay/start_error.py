"""The error of the measured states that windows start from, taken out of residuals.

A window is replayed from a measured state, and that state has the sensors' noise. Half a second later a joint that
started 5 mrad/s too fast is 2 mrad too far: often more than anything that parameters change. Worse, it biases them: a
joint that rests, replayed from a speed that is noise, is best kept at rest by a friction that it has not.

So a start state is fitted along with the parameters, in each window, within its noise. Residuals are linear in errors
so small, and what they explain is projected out (variable projection, Golub and Pereyra 1973): of residuals, and by
that of slopes, which are differences of residuals.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.replay.samples import correlation_time
from dynreg.replay.windows import Replayer
from dynreg.sim.robot import Robot

ROUNDS = 3  # the noise of residuals is that of what is left when start errors are out, which need it


@dataclass(frozen=True, eq=False)
class StartErrors:
    """What errors of the start states do to the residuals of W' windows.

    slopes : (W', F, C) change of a window's F = T * S' residuals with each of C channels of its start state, of one
    standard deviation of its noise. gain : (W', C, F) start errors, in these units, that residuals tell.
    """

    slopes: np.ndarray
    gain: np.ndarray

    def removed(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (n, W', T, S') without what the start states explain; NaN where they were."""
        n, windows = residuals.shape[:2]
        flat = residuals.reshape(n, windows, -1)
        error = np.einsum("wcf,nwf->nwc", self.gain, np.nan_to_num(flat), optimize=True)
        return (flat - np.einsum("wfc,nwc->nwf", self.slopes, error, optimize=True)).reshape(residuals.shape)


@dataclass(frozen=True, eq=False)
class StartSlopes:
    """The slopes (W', F, C) of `StartErrors`; C is 0 where the measured start states are believed."""

    slopes: np.ndarray

    def errors(self, residual: np.ndarray) -> StartErrors:
        """Start errors, as far as residuals (W', T, S') of a simulator tell them.

        What noise is in the residuals is what is left of them, which takes some rounds. Where the simulator is far
        from the robot, that is much, and the measured start states are believed.
        """
        known, slopes = np.isfinite(residual), self.slopes
        flat = np.nan_to_num(residual).reshape(len(residual), -1)
        left, gain = residual, np.zeros((len(flat), slopes.shape[2], flat.shape[1]))
        for _ in range(ROUNDS if slopes.shape[2] else 0):
            weight = np.where(known, 1.0 / np.maximum(_variance(left), 1e-300), 0.0).reshape(flat.shape)
            weighted = np.swapaxes(slopes * weight[..., None], 1, 2)
            gain = np.linalg.solve(weighted @ slopes + np.eye(slopes.shape[2]), weighted)
            left = (flat - (slopes @ (gain @ flat[..., None]))[..., 0]).reshape(residual.shape)
            left[~known] = np.nan
        return StartErrors(slopes, gain.astype(slopes.dtype))


def believed(residual: np.ndarray) -> StartSlopes:
    """No errors in the start states of windows with residuals (W', T, S')."""
    return StartSlopes(np.zeros((len(residual), residual[0].size, 0)))


def noisy_channels(robot: Robot) -> np.ndarray:
    """(C,) the channels whose noise is stated: their start may be wrong, and costs a replay to know what that does."""
    return np.flatnonzero(robot.sensor_noise > 0)


def start_slopes(
    replayer: Replayer, values: np.ndarray, chosen: np.ndarray, residual: np.ndarray
) -> StartSlopes:
    """Of the chosen windows, which a simulator (P,) replays with residuals (W', T, S').

    By differences of one standard deviation, a replay a channel; 0 where nothing was measured.
    """
    channels, noise = noisy_channels(replayer.robot), replayer.robot.sensor_noise
    initial = np.repeat(replayer.windows.run.initial[None, chosen], len(channels), axis=0)
    initial[np.arange(len(channels)), :, channels] += noise[channels, None]
    change = np.nan_to_num(replayer.residuals_from(values, chosen, initial) - residual).astype(np.float32)
    return StartSlopes(np.moveaxis(change.reshape(len(channels), len(chosen), -1), 0, 2))


def _variance(residual: np.ndarray) -> np.ndarray:
    """(1, 1, S') variance of the residuals (W', T, S') of each channel, times the samples that go into one."""
    out = []
    for c in range(residual.shape[2]):
        series = [x[np.isfinite(x)] for x in residual[..., c]]
        series = [x for x in series if len(x) > 3 and np.any(x != x[0])]
        times = [correlation_time(x) for x in series]
        square = np.concatenate([np.zeros(1), *series]) ** 2
        out.append(np.median(times or [1.0]) * square.sum() / max(len(square) - 1, 1))
    return np.array(out)[None, None]
