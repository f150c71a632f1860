"""A drive that gives all it can: what it would have done does not show in the log."""

import numpy as np

from dynreg.data.behaviour.joint import Joint, Run, Seen, grain

MOVING = 0.05  # of the speed that 95 % of the rows stay below: slower, a drive may hold a load with the same effort
SHARE = 0.1  # of the moving rows at the extreme: a start and a stop alone take less
LIMIT_SHARE = (
    0.5  # of those for a command at its limit: it is known, and only a log that is mostly so tells little
)
TOP, BELOW = 0.005, 0.1  # of the effort's range: the flat top, and what lies under it
# Times the rows under the top: a sine has 0.22 times as many in the top, a clipped one far more.
PILED = 2.0
NEAR_ZERO = 0.25  # of the largest effort: an extreme below it is where an effort without sign ends, no limit
STEPS = 20  # of the sensor in its range: a coarser one has no top that could be told from its steps
BEYOND = 0.05  # of the command, by which it must lie beyond what was given, where effort is commanded


def saturation(joint: Joint) -> Seen | None:
    """The share of the moving rows [%] at the largest effort, and that effort."""
    moving = joint.pooled(_moving) > 0
    given, asked = joint.pooled(lambda run: run.effort), joint.pooled(lambda run: run.asked)
    if moving.sum() < 100:
        return None
    if len(given) and (joint.led or len(asked)):  # else it may be what was commanded
        flat, top = _flat(given)
        if len(asked) and len(flat):
            flat &= np.abs(asked) > (1 + BEYOND) * np.abs(given)
        share = float(flat[moving].mean()) if len(flat) else 0.0
        if share >= SHARE:
            return Seen("saturation", joint.effort, (100 * share, top), ("%", joint.effort_unit))
    if len(asked) and joint.limits is not None:
        low, high = joint.limits
        edge = TOP * (high - low)
        share = float(((asked >= high - edge) | (asked <= low + edge))[moving].mean())
        if share >= LIMIT_SHARE:
            kind = f"commanded {joint.asked}"
            return Seen("saturation", kind, (100 * share, max(abs(low), abs(high))), ("%", joint.asked_unit))
    return None


def _moving(run: Run) -> np.ndarray:
    """(T,) 1.0 where the joint moves."""
    speed = np.abs(run.rate)
    return (speed > max(MOVING * float(np.quantile(speed, 0.95)), grain(run.position) / run.step)).astype(
        float
    )


def _flat(effort: np.ndarray) -> tuple[np.ndarray, float]:
    """(N,) whether an effort stands at its flat top, up or down, and how large it is there; nothing without one."""
    span, most = float(np.ptp(effort)), float(np.abs(effort).max())
    if span < STEPS * grain(effort) or most == 0:
        return np.empty(0, dtype=bool), 0.0
    flat, tops = np.zeros(len(effort), dtype=bool), []
    for sign in (1.0, -1.0):
        up = sign * effort
        top = float(up.max())
        at, under = up >= top - TOP * span, (up < top - TOP * span) & (up >= top - BELOW * span)
        if top > NEAR_ZERO * most and at.sum() > PILED * max(under.sum(), 1):
            flat |= at
            tops.append(top)
    return (flat, max(tops)) if tops else (np.empty(0, dtype=bool), 0.0)
