"""A joint that stands at its stop while its target lies beyond, or bounces there."""

from dataclasses import dataclass, replace

import numpy as np

from dynreg.data.behaviour.joint import Joint, Seen, grain

NEAR = 0.02  # of the way that the position goes in all: a stop gives way a little
SHARE = 0.1  # of the rows: each peak of a sine that is followed well has as many so near
IMPACT = 0.05  # of the rows, that may lie further out: where the joint bounces against its stop
MARGIN = 0.05  # of that way, by which the target lies beyond
# Times the offset that is usual elsewhere, in the slower half of the rows: a soft drive, or one with dry friction, is
# as far off its target there. Friction at the turns of a hobby arm makes 0.9 of it.
USUAL = 2.0
STANDS = 5.0  # times what the position moves there, the target does: what a load holds moves with its target
FAR = 0.25  # of the way: no load alone holds a joint so far off its target on one side
ELSEWHERE = 0.05  # of the rows that must lie elsewhere, to tell what offset is usual
# Of the rows with a target beyond all that the joint reaches: those in which it stands at one place, and of those with
# a target short of it, in which it does not. A servo that bounced on both of its stops stood in 0.56 and more.
MOSTLY = 0.5


@dataclass(frozen=True, eq=False)
class _Stands:
    """The rows of a joint at one stop: rows (N,) are those. beyond : how far the target is beyond, in its unit."""

    place: float
    rows: np.ndarray
    beyond: float


def stop(joint: Joint) -> Seen | None:
    """Where the joint stands [its unit], in which share of the rows [%], and how far beyond its target is."""
    place, target = joint.pooled(lambda run: run.position), joint.pooled(lambda run: run.target)
    speed = np.abs(joint.pooled(lambda run: run.rate))
    if not len(target) or joint.reach <= 20 * grain(place):
        return None
    found = {}
    for kind, sign in (("largest", 1.0), ("smallest", -1.0)):
        at, to = sign * place, sign * target
        one = _at_end(at, to, speed, joint.reach) or _bounces(at, to, speed, joint.reach)
        if one is not None:
            found[kind] = replace(one, place=sign * one.place)
    if not found:
        return None
    places = [one.place for one in found.values()]
    share = 100 * float(np.any([one.rows for one in found.values()], axis=0).mean())
    numbers = (*places, share, max(one.beyond for one in found.values()))
    kind = "both" if len(found) > 1 else [*found][0]
    return Seen("stop", kind, numbers, (*(joint.unit for _ in places), "%", joint.unit))


def _at_end(at: np.ndarray, to: np.ndarray, speed: np.ndarray, reach: float) -> _Stands | None:
    """The rows at the largest of the positions; None where the joint is as far off its target elsewhere."""
    off = to - at
    end = float(np.quantile(at, 1 - IMPACT))
    stands = (at >= end - NEAR * reach) & (off > MARGIN * reach)
    if stands.mean() < SHARE or (~stands).mean() < ELSEWHERE:
        return None
    beyond = float(np.quantile(off[stands], 0.95))
    usual = _usual(off[~stands], speed[~stands])
    alone = _spread(to[stands]) > max(STANDS * _spread(at[stands]), MARGIN * reach)
    if not (beyond > USUAL * usual and (alone or beyond > FAR * reach)):
        return None
    return _Stands(float(np.median(at[stands])), stands, beyond)


def _bounces(at: np.ndarray, to: np.ndarray, speed: np.ndarray, reach: float) -> _Stands | None:
    """The rows at the place where a joint mostly stands when its target is beyond all that it reaches.

    It may go further for a moment, and be as far off its target at another stop. A target that only scales its motion,
    or one that a dead joint does not mind, is no such case: the place must not move with the target, and the joint must
    leave it when the target does.
    """
    far = to > at.max() + FAR * reach
    if far.mean() < SHARE:
        return None
    low = _fullest(at[far], NEAR * reach)
    there = (at >= low) & (at <= low + NEAR * reach)
    stands, back = there & far, to < low - MARGIN * reach
    if stands.mean() < SHARE or stands.sum() < MOSTLY * far.sum():
        return None
    if back.mean() < ELSEWHERE or there[back].mean() > 1 - MOSTLY:
        return None
    moves = _spread(to[stands]) / np.ptp(to) > STANDS * _spread(at[stands]) / reach
    beyond = float(np.quantile((to - at)[stands], 0.95))
    within = (to >= at.min()) & (to <= at.max())
    # both are within the reach then, and so is what lies between them
    usual = _usual((to - at)[within], speed[within]) if within.mean() >= ELSEWHERE else reach
    if not (moves and beyond > USUAL * usual):
        return None
    return _Stands(float(np.median(at[stands])), stands, beyond)


def _usual(off: np.ndarray, speed: np.ndarray) -> float:
    """How far a joint is off its target in the slower half of some rows."""
    return float(np.quantile(np.abs(off[speed <= np.median(speed)]), 0.95))


def _fullest(values: np.ndarray, width: float) -> float:
    """The lower end of the interval of this width that holds most of some values."""
    rising = np.sort(values)
    held = np.searchsorted(rising, rising + width, "right") - np.arange(len(rising))
    return float(rising[np.argmax(held)])


def _spread(values: np.ndarray) -> float:
    """How far the middle four fifths of some values lie apart."""
    low, high = np.quantile(values, [0.1, 0.9])
    return float(high - low)
