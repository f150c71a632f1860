"""Joints that do not do what their targets say: another joint's target, another unit, sign or zero."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.behaviour.joint import Joint, Seen, grain

LATE = (
    0.0,
    0.02,
    0.05,
    0.1,
    0.15,
    0.2,
    0.3,
)  # [s] by which a position may follow; servos were seen to take 0.23
ROWS = 4000  # rows that are looked at, of each joint: correlations of more say no more
FOLLOWS = 0.9  # correlation of a joint that follows a target; servos with friction have 0.95 and more
OTHERS, BETTER = 0.95, 0.25  # correlation with another joint's target, and by how much that is the better one
CLOSER = 0.3  # times the error against its own target: that against another's
AS_LARGE = (
    0.5,
    2.0,
)  # slope of a position on its target, where both are in one unit: soft drives under load have 0.6
DEGREES = 180 / np.pi
UNIT = 0.2  # share by which a slope may differ from the factor of a unit: that of a soft drive is below 1
FLIPPED = -0.8  # correlation of a joint that goes the other way, and at no delay follows
# [rad] A droop under load is less: 0.06 on a hobby arm of the data, 0.2 in legs of soft drives that bear a robot.
ZERO, FAR = 0.1, 0.35
STEADY = 3.0  # times the half spread of the error: a droop changes with the pose, a zero does not
OF_RANGE = 0.1  # of the target's range, that a wrong zero exceeds


@dataclass(frozen=True, eq=False)
class _Fit:
    """How positions follow targets: (J, J) of joint by target.

    r : the best correlation of those at each delay, now : without delay. slope : of the position on the target. error :
    root of the mean square of their difference, at the best delay.
    """

    r: np.ndarray
    now: np.ndarray
    slope: np.ndarray
    error: np.ndarray


def targets(joints: Sequence[Joint]) -> dict[str, Seen]:
    """{joint: what is wrong between its position and its target}, of those where something is."""
    some = [j for j in joints if all(run.target is not None for run in j.runs)]
    alike: dict[tuple, list[Joint]] = {}
    for joint in some:
        alike.setdefault((joint.unit, *(len(run.time) for run in joint.runs)), []).append(joint)
    out: dict[str, Seen] = {}
    for group in alike.values():
        fit = _fitted(group)
        for number, joint in enumerate(group):
            seen = _order(group, fit, number) or _scale(joint, fit, number) or _zero(joint, fit, number)
            if seen is not None:
                out[joint.name] = seen
    return out


def _order(group: Sequence[Joint], fit: _Fit, number: int) -> Seen | None:
    """Another joint's target that this one follows, and its own that it does not."""
    own, others = fit.r[number, number], fit.r[number]
    best = int(np.argmax(np.where(np.arange(len(group)) == number, -2.0, others)))
    if best == number or others[best] < OTHERS or others[best] < own + BETTER:
        return None
    close = fit.error[number, best] < CLOSER * fit.error[number, number]
    if not close or not AS_LARGE[0] <= fit.slope[number, best] <= AS_LARGE[1]:
        return None
    return Seen("target", "order", (float(others[best]), float(own)), ("", ""), group[best].name)


def _scale(joint: Joint, fit: _Fit, number: int) -> Seen | None:
    """A position that is its target times a factor: another unit, or another sign."""
    r, slope = float(fit.r[number, number]), float(fit.slope[number, number])
    if r > FOLLOWS:
        for unit, factor in (("the position", DEGREES), ("the target", 1 / DEGREES)):
            if joint.unit == "rad" and abs(slope / factor - 1) < UNIT:
                return Seen("target", "unit", (slope,), ("",), unit)
    if fit.now[number, number] < FLIPPED and r < 0.5:
        return Seen("target", "sign", (float(fit.now[number, number]),), ("",))
    return None


def _zero(joint: Joint, fit: _Fit, number: int) -> Seen | None:
    """A position that is off its target in all of the log, by a constant or by far; of angles, whose size is known."""
    if joint.unit != "rad":
        return None
    target = joint.pooled(lambda run: run.target)
    low, middle, high = np.quantile(joint.pooled(lambda run: run.position) - target, [0.05, 0.5, 0.95])
    span = float(np.diff(np.quantile(target, [0.02, 0.98]))[0])
    off = abs(middle)
    follows = fit.r[number, number] > FOLLOWS and AS_LARGE[0] <= fit.slope[number, number] <= AS_LARGE[1]
    if follows and off > max(ZERO, OF_RANGE * span) and off > STEADY * (high - low) / 2:
        return Seen("target", "zero", (float(middle),), (joint.unit,))
    if low * high > 0 and min(abs(low), abs(high)) > FAR:
        return Seen("target", "far", (float(min(abs(low), abs(high))),), (joint.unit,))
    return None


def _fitted(group: Sequence[Joint]) -> _Fit:
    """How all positions follow all targets, each pair at the delay at which it fits best."""
    step = group[0].runs[0].step
    best = _at_once(*_rows(group, 0))
    for late in LATE[1:]:
        fit = _at_once(*_rows(group, round(late / step)))
        better = fit.r > best.r
        chosen = (np.where(better, getattr(fit, k), getattr(best, k)) for k in ("r", "slope", "error"))
        r, slope, error = chosen
        best = _Fit(r, best.now, slope, error)
    return best


def _rows(group: Sequence[Joint], late: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, J) positions, and the targets so many rows before them."""
    every = [
        tuple(np.stack([getattr(j.runs[k], of) for j in group], axis=1) for of in ("position", "target"))
        for k in range(len(group[0].runs))
    ]
    pairs = [(p[late:], t[: len(t) - late]) if len(p) > 2 * late else (p, t) for p, t in every]
    place, target = (np.concatenate(part) for part in zip(*pairs, strict=True))
    thin = max(1, len(place) // ROWS)
    return place[::thin], target[::thin]


def _at_once(place: np.ndarray, target: np.ndarray) -> _Fit:
    p, t = place - place.mean(axis=0), target - target.mean(axis=0)
    size_p, size_t = (np.sqrt(np.mean(x**2, axis=0)) for x in (p, t))
    # what stands, but for steps of its sensor, follows nothing, and nothing follows it
    still_p = size_p <= np.array([3 * grain(one) for one in place.T])
    still_t = size_t <= 1e-6 * np.maximum(np.abs(target).max(axis=0), 1e-9)
    both = p.T @ t / len(p)
    with np.errstate(divide="ignore", invalid="ignore"):
        r, slope = both / np.outer(size_p, size_t), both / size_t**2
    r = np.where(still_p[:, None] | still_t[None] | ~np.isfinite(r), 0.0, r)
    error = np.sqrt(np.mean((place[:, :, None] - target[:, None, :]) ** 2, axis=0))
    return _Fit(r, r, np.nan_to_num(slope), error)
