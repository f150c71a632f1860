"""Between motor and joint: dry friction, bristles, play and springs.

`kernels` compiles it.
"""

import numpy as np

from dynreg.truths.rows import (
    ARMATURE,
    ASYMMETRIC,
    BEND,
    BRISTLE,
    COMPLIANCE,
    COULOMB,
    DRIFT,
    EMF_OUTSIDE,
    EXTRA,
    FADES,
    GAP,
    LOAD,
    LOAD_EXTRA,
    LOAD_GROWTH,
    MOTOR_SIDE,
    OMEGA,
    PATCH,
    PATCH_AT,
    PATCH_WIDE,
    THETA,
)

ROTOR = 0.5  # of the reflected inertia that turns with the motor: by contract with robot folders
STILL = 1e-4  # rad/s below which a joint counts as at rest
CONTACT = 0.2  # of a flank's natural frequency times the time step: as hard as the step can follow
RING = 0.5  # damping ratio of gears and bristles


def dry(x, i, q, v, given, net, bias, limit, time):
    """[N m] bound of dry friction at an angle q and a speed v, where a motor gives `net` and the load takes `bias`."""
    carried = 0.5 * abs(net + bias)
    bound = x[COULOMB, i] + x[EXTRA, i] * np.exp(-((v / x[FADES, i]) ** 2)) + x[DRIFT, i] * time
    bound += x[PATCH, i] * np.exp(-(((q - x[PATCH_AT, i]) / x[PATCH_WIDE, i]) ** 2))
    share = x[LOAD, i] + x[LOAD_EXTRA, i] * np.exp(-abs(v) / x[FADES, i])
    bound += (share + x[LOAD_GROWTH, i] * min(carried / limit, 1.0)) * carried
    if x[ASYMMETRIC, i] != 0.0:
        way = v if abs(v) > STILL else given - bias
        bound = max(bound + x[ASYMMETRIC, i] * np.sign(way), 0.0)
    return bound


def bristles(x, y, i, v, bound, inertia, h):
    """([N m], [N m s/rad]) torque and damping of bristles that bend before they slide under `bound`.

    Canudas de Wit et al., IEEE TAC 40(3), 1995: rate of z = v - stiffness |v| z / bound. The micro damping, which makes
    a stuck joint ring once, fades with speed.
    """
    stiff = x[COULOMB, i] / x[BEND, i]
    y[BRISTLE, i] = (y[BRISTLE, i] + h * v) / (1.0 + h * abs(v) * stiff / bound)
    fine = RING * np.sqrt(stiff * inertia) * np.exp(-((v / x[FADES, i]) ** 2))
    return stiff * y[BRISTLE, i], fine


def flank(x, i, h):
    """[N m/rad] of the spring between motor and joint: the gear's own, or flanks as hard as the step can follow."""
    hard = ROTOR * x[ARMATURE, i] * (CONTACT / h) ** 2
    return min(1.0 / x[COMPLIANCE, i], hard) if x[COMPLIANCE, i] > 0.0 else hard


def laid(x, y, i, q, given, h):
    """[rad] the joint's angle as the log begins; the joint was held: its gear lies on the side that is pushed."""
    lies = 0.5 * x[GAP, i] * np.sign(given) + given / flank(x, i, h)
    if x[MOTOR_SIDE, i] > 0.5:
        return q - lies
    y[THETA, i] += lies
    return q


def passed(x, y, i, q, v, given, emf, h):
    """([N m], [N m s/rad]) what a loose or soft gear passes on, and the damping behind it; moves the motor."""
    rotor, hard, half = ROTOR * x[ARMATURE, i], flank(x, i, h), 0.5 * x[GAP, i]
    bent, through = y[THETA, i] - q, 0.0
    if abs(bent) >= half:
        bent -= np.sign(bent) * half
        through = hard * bent + 2.0 * RING * np.sqrt(hard * rotor) * (y[OMEGA, i] - v)
        if half > 0.0 and through * bent < 0.0:
            through = 0.0  # flanks push, they do not pull
    brakes = 0.0 if x[EMF_OUTSIDE, i] > 0.5 else emf
    y[OMEGA, i] += h / (rotor + 0.5 * h * brakes) * (given - brakes * y[OMEGA, i] - through)
    y[THETA, i] += 0.5 * h * y[OMEGA, i]
    return through, emf - brakes
