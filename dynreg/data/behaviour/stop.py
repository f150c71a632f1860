"""A joint that stands at its stop while its target lies beyond."""

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


def stop(joint: Joint) -> Seen | None:
    """Where the joint stands [its unit], in which share of the rows [%], and how far beyond its target is."""
    place, target = joint.pooled(lambda run: run.position), joint.pooled(lambda run: run.target)
    speed, reach = np.abs(joint.pooled(lambda run: run.rate)), joint.reach
    if not len(target) or reach <= 20 * grain(place):
        return None
    for sign in (1.0, -1.0):
        at, off = sign * place, sign * (target - place)
        end = float(np.quantile(at, 1 - IMPACT))
        stands = (at >= end - NEAR * reach) & (off > MARGIN * reach)
        if stands.mean() < SHARE or (~stands).mean() < ELSEWHERE:
            continue
        beyond = float(np.quantile(off[stands], 0.95))
        slow = ~stands & (speed <= np.median(speed[~stands]))
        usual = float(np.quantile(np.abs(off[slow]), 0.95))
        alone = _spread(target[stands]) > max(STANDS * _spread(place[stands]), MARGIN * reach)
        if beyond > USUAL * usual and (alone or beyond > FAR * reach):
            numbers = (float(sign * np.median(at[stands])), 100 * float(stands.mean()), beyond)
            return Seen("stop", "largest" if sign > 0 else "smallest", numbers, (joint.unit, "%", joint.unit))
    return None


def _spread(values: np.ndarray) -> float:
    """How far the middle four fifths of some values lie apart."""
    low, high = np.quantile(values, [0.1, 0.9])
    return float(high - low)
