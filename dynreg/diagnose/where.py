"""The errors of a simulator by channel, joint and regime of motion.

An error belongs to the command interval before it. Regimes overlap: a reversal is also slow.
"""

from dataclasses import dataclass

import numpy as np

from dynreg.diagnose.signals import JointSignals, joint_of_channel, joint_signals
from dynreg.replay.residual import scaled
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot

# Definitions of the regimes.
REVERSAL = 0.1  # s around a change of direction
SLOW = 0.1  # of the 95th percentile of the speed
TURNING = 0.25  # the same, for what still counts as part of a reversal
TOP = 0.8  # quantile above which speed and load are high
USUAL = 0.95  # quantile that defines the "lively" speed: the fastest rows are impacts or lost samples
MOVES, SIGMA = (
    0.05,
    3.0,
)  # share of the lively speed, and standard deviations of noise: slower has no direction


@dataclass(frozen=True)
class ErrorRow:
    """The error of a simulator on one channel in one regime; "overall" stands for all samples.

    error : mean absolute rollout error in the channel's unit; a diverged simulation counts as ten times the motion.
    share : of the simulator's whole error, in units of the channels' spread times their weights.
    ratio : mean error in the regime over the mean elsewhere; None if the regime is everywhere, or no error elsewhere.
    """

    channel: str
    unit: str
    joint: str | None
    regime: str
    error: float
    share: float
    ratio: float | None
    samples: int


def split_errors(robot: Robot, windows: Windows, states: np.ndarray) -> tuple[ErrorRow, ...]:
    """Rows for every measured channel and regime with samples.

    states : (W, T+1, S) rollouts of one simulator through the windows.
    """
    signals = joint_signals(robot, windows)
    everywhere = _of_the_clock(windows)
    by_joint = {j: everywhere | motion_regimes(s, windows.period) for j, s in signals.items()}
    rest = dict(everywhere)
    if signals:  # the regimes of channels that belong to no driven joint
        rest["saturation"] = np.any([s.saturated for s in signals.values()], axis=0)
        rest["drive_off"] = np.any([~s.enabled for s in signals.values()], axis=0)
    # (W, T, S) in units of the spread; NaN where nothing was measured
    errors = np.abs(scaled(states[:, 1:], windows.measured[:, 1:], windows.spread))
    rows = []
    for c, channel in enumerate(robot.file.channels):
        if not np.isfinite(windows.measured[:, 1:, c]).any():
            continue
        joint = joint_of_channel(channel.name, signals)
        for regime, mask in (rest if joint is None else by_joint[joint]).items():
            found = _measure(errors, mask, c, windows)
            if found is not None:
                rows.append(ErrorRow(channel.name, channel.unit, joint, regime, *found))
    return tuple(rows)


def motion_regimes(signals: JointSignals, period: float) -> dict[str, np.ndarray]:
    """{regime: (W, T)} of one joint; regimes that its motion does not have are empty masks.

    reversals : slower than a quarter of the lively speed within 0.1 s of a change of direction that stands out of
        the noise. low_speed : below a tenth of it. high_speed, high_load : the top fifth. The lively speed is the
        95th percentile. saturation : the drive is at the limit of its nominal law.
    """
    speed = np.abs(signals.velocity)
    lively, load = _quantile(speed, USUAL), np.where(signals.enabled, signals.load, np.nan)
    with np.errstate(invalid="ignore"):
        return {
            "reversals": (speed < TURNING * lively) & _near_turns(signals, lively, period),
            "low_speed": speed < SLOW * lively,
            "high_speed": speed > _quantile(speed, TOP),
            # ties with the limit are all in, as a saturated drive's are
            "high_load": (load >= _quantile(load, TOP)) & (load > 0),
            "saturation": signals.saturated,
            "drive_off": ~signals.enabled,
        }


def _measure(
    errors: np.ndarray, mask: np.ndarray, channel: int, windows: Windows
) -> tuple[float, float, float | None, int] | None:
    """Mean error [channel unit], share, ratio and samples; None where the regime has no samples."""
    own = errors[..., channel]
    known = np.isfinite(own)
    inside = known & mask
    samples = int(inside.sum())
    if not samples:
        return None
    total = float(np.nansum(errors * windows.weight))
    share = float(own[inside].sum() * windows.weight[channel]) / total if total > 0 else 0.0
    mean, elsewhere = float(own[inside].mean()), own[known & ~mask]
    ratio = mean / float(elsewhere.mean()) if elsewhere.any() else None
    return mean * float(windows.spread[channel]), share, ratio, samples


def _of_the_clock(windows: Windows) -> dict[str, np.ndarray]:
    """Regimes by time alone: thirds of the rollouts, and of the log where it is known when each window began."""
    shape = (len(windows), windows.run.steps)
    t = np.broadcast_to((np.arange(shape[1]) + 0.5) / shape[1], shape)
    out = {"overall": np.ones(shape, dtype=bool), "early": t < 1 / 3, "late": t > 2 / 3}
    begin = windows.run.begin
    if begin is not None and np.ptp(begin) > 0:
        at = begin[:, None] + windows.period * np.arange(shape[1])
        part = (at - at.min()) / np.ptp(at)
        out |= {"log_begin": part < 1 / 3, "log_end": part > 2 / 3}
    return out


def _near_turns(signals: JointSignals, lively: float, period: float) -> np.ndarray:
    """(W, T) within REVERSAL of a change of direction; what moves less than the noise keeps its direction."""
    least = max(MOVES * lively, SIGMA * signals.velocity_noise)
    velocity = np.nan_to_num(signals.velocity)
    moving = np.abs(velocity) > least
    rows = np.arange(velocity.shape[1])
    last = np.maximum.accumulate(np.where(moving, rows, -1), axis=1)
    direction = np.where(last >= 0, np.sign(np.take_along_axis(velocity, np.maximum(last, 0), axis=1)), 0.0)
    turned = np.zeros(velocity.shape, dtype=bool)
    turned[:, 1:] = direction[:, 1:] * direction[:, :-1] < 0
    near = turned.copy()
    for shift in range(1, max(1, round(REVERSAL / period)) + 1):
        near[:, shift:] |= turned[:, :-shift]
        near[:, :-shift] |= turned[:, shift:]
    return near


def _quantile(values: np.ndarray, q: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, q)) if len(known) else np.nan
