"""A joint that oscillates near half the sampling rate: the log shows the drive's instability, not the joint."""

from dataclasses import dataclass, fields

import numpy as np

from dynreg.data.behaviour.joint import Joint, Run, Seen, grain

ROWS = 64  # of a window: 1.6 % of the sampling rate is told apart, and a burst of a second is still seen at 100 Hz
FAST, SLOW = (
    0.4,
    0.1,
)  # of the sampling rate: chatter lies above the one, motion and its harmonics below the other
# Of the power above `SLOW`, the share above `FAST`. White noise of a velocity has 0.25, the difference of two noisy
# positions 0.39; 64 rows scatter by 0.06.
PEAK = 0.8
GRAINS = 3.0  # steps of the sensor: an encoder that flickers between two counts has one
STRONG = 0.25  # of the velocity below `SLOW`: less than that leaves the motion to be seen
SHARE = 0.1  # of the windows: one burst, as of a collision, is less
STRANGE = 0.5  # of the velocity: what the windows' mean velocities differ by from how far they went; white noise: 0.13
TRAVELS = (
    20  # steps of the sensor that the position goes in all: less, and a velocity is compared with nothing
)


@dataclass(frozen=True, eq=False)
class _Windows:
    """Of each window (W,): mean squares of slow motion and of fast, whether the fast one is a peak and where [Hz].

    rate : [Hz] of rows. mean, way : the mean velocity, and that by how far the position went.
    """

    slow: np.ndarray
    fast: np.ndarray
    peak: np.ndarray
    at: np.ndarray
    rate: np.ndarray
    mean: np.ndarray
    way: np.ndarray


def chatter(joint: Joint) -> Seen | None:
    """The share of the log [%] in which the joint oscillates so, its frequency and that of the rows [Hz], its speed."""
    every = [_windows(run) for run in joint.runs]
    found = _Windows(*(np.concatenate([getattr(one, f.name) for one in every]) for f in fields(_Windows)))
    if not len(found.peak):
        return None
    high = found.peak & (found.fast > STRONG**2 * np.mean(found.slow))
    if not high.any() or high.mean() < SHARE:
        return _aliased(joint, found)
    size = float(np.sqrt(2 * np.median(found.fast[high])))
    at, rate = (float(np.median(one[high])) for one in (found.at, found.rate))
    return Seen(
        "chatter", "", (100 * float(high.mean()), at, rate, size), ("%", "Hz", "Hz", f"{joint.unit}/s")
    )


def unmeasured(joint: Joint) -> Seen | None:
    """A velocity that never changes, while the position goes somewhere: nobody measured it."""
    velocity, place = (joint.pooled(lambda run, of=of: getattr(run, of)) for of in ("velocity", "position"))
    if not len(velocity) or np.ptp(velocity) > 0 or joint.reach <= TRAVELS * grain(place):
        return None
    went = sum(float(run.position[-1] - run.position[0]) for run in joint.runs)
    mean = went / sum(float(run.time[-1] - run.time[0]) for run in joint.runs)
    if abs(mean - velocity[0]) < STRANGE * abs(velocity[0]):
        return None  # it turns steadily, and so it says
    return Seen("velocity", "constant", (float(velocity[0]),), (f"{joint.unit}/s",))


def _aliased(joint: Joint, found: _Windows) -> Seen | None:
    """A velocity that no motion of the position goes with: an oscillation of which each row shows the same phase.

    Where the two go together, but by another factor, the velocity is in another unit.
    """
    velocity, place = (joint.pooled(lambda run, of=of: getattr(run, of)) for of in ("velocity", "position"))
    if not len(velocity) or len(found.mean) < 3 or joint.reach <= TRAVELS * grain(place):
        return None
    size, off = np.sqrt(np.mean(velocity**2)), np.sqrt(np.mean((found.mean - found.way) ** 2))
    moves = np.std(found.mean) > 0 and np.std(found.way) > 0
    together = np.corrcoef(found.mean, found.way)[0, 1] if moves else 0.0
    if not off > max(STRANGE * size, GRAINS * grain(velocity)) or abs(together) > STRANGE:
        return None
    numbers = (float(size), float(np.sqrt(np.mean(found.way**2))))
    return Seen("chatter", "aliased", numbers, (f"{joint.unit}/s",) * 2)


def _windows(run: Run) -> _Windows:
    """The windows of a run: of its velocity, else, where that has no peak, of the differences of its position."""
    count, step = len(run.time) // ROWS, run.step
    rate = np.append(np.diff(run.position), 0.0) / step
    least = GRAINS * grain(run.position) / step
    velocity = rate if run.velocity is None else run.velocity
    slow, fast, peak, at = _spectrum(velocity, count, max(least, GRAINS * grain(velocity)))
    if run.velocity is not None:
        other = _spectrum(rate, count, least)
        instead = other[2] & ~peak
        slow, fast, peak, at = (
            np.where(instead, b, a) for a, b in zip((slow, fast, peak, at), other, strict=True)
        )
    time, place, speed = (
        one[: count * ROWS].reshape(count, ROWS) for one in (run.time, run.position, velocity)
    )
    span = np.diff(time, axis=1)
    lasts = span.sum(axis=1)
    mean = (0.5 * (speed[:, 1:] + speed[:, :-1]) * span).sum(axis=1) / lasts
    way = (place[:, -1] - place[:, 0]) / lasts
    return _Windows(slow, fast, peak, at / step, np.full(count, 1 / step), mean, way)


def _spectrum(values: np.ndarray, count: int, least: float) -> tuple[np.ndarray, ...]:
    """(W,) slow and fast mean squares, peak, and where [share of the rate], of `count` windows.

    least : amplitude of a peak.
    """
    taper, freq = np.hanning(ROWS), np.fft.rfftfreq(ROWS)
    rows = values[: count * ROWS].reshape(count, ROWS)
    middle = rows.mean(axis=1)
    power = 2 * np.abs(np.fft.rfft((rows - middle[:, None]) * taper)) ** 2 / (ROWS * np.sum(taper**2))
    above = freq >= FAST
    fast = power[:, above].sum(axis=1)
    peak = (fast > PEAK * power[:, freq >= SLOW].sum(axis=1)) & (np.sqrt(2 * fast) > least)
    at = freq[above][power[:, above].argmax(axis=1)]
    return power[:, freq < SLOW].sum(axis=1) + middle**2, fast, peak, at
