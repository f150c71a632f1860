"""Driven joints of a chain under commands: drives, friction, gears and encoders, 0.1 ms at a time.

Position half a step, velocity a step, position half a step. Dry friction is the impulse that stops the joints, at most
its bound in each (Gauss and Seidel over the joints); bristles are forces with a state of their own. Joints with play
or a soft gear have a motor of their own.

`kernels` compiles it.
"""

import numpy as np

from dynreg.truths.drives import command, motor, servo
from dynreg.truths.gears import ROTOR, bristles, dry, laid, passed
from dynreg.truths.links import dynamics
from dynreg.truths.rows import (
    ARMATURE,
    BACK_EMF,
    BEND,
    COMMAND_GAIN,
    COMPLIANCE,
    ECCENTRIC,
    ECCENTRIC_COSINE,
    EMF_OUTSIDE,
    FEEDBACK_DELAY,
    GAP,
    LIMIT,
    LIMITED,
    MOTOR_SIDE,
    OFFSET,
    OMEGA,
    PROFILE,
    SCALE,
    SMOOTH,
    STATE,
    THETA,
    VISCOUS,
)
from dynreg.truths.solve import invert, stop

STEP = 1e-4  # s


def episode(
    chain, x, stand, coupling, commands, power, enabled, push, period, count, begin, q, v, heat, told
):  # fmt: skip
    """Move the joints through commands (T, n), each held for `period` [s] of true time, in `count` steps.

    chain : `Chain.parts`, of n joints and a stand's before them where stand (2,) [N m/rad, N m s/rad] is not 0.
    coupling : [N m/rad] of a cable between the last two joints. power (T,) : supply over nominal; enabled (T,);
    push (T, n) [N m] of disturbances. q, v (n,) at the start; heat (2, n) of the motors, changed. told (T count + 1, 2,
    n), written: angle and speed where the encoders sit, at every step.
    """
    n, whole, h = len(q), len(chain[2]), period / count
    s = whole - n
    Q, V = np.zeros(whole), np.zeros(whole)
    Q[s:], V[s:] = q, v
    M, inverse, column = np.zeros((whole, whole)), np.zeros((whole, whole)), np.zeros(whole)
    bias, right, damping = np.zeros(whole), np.zeros(whole), np.zeros(whole)
    bound, impulse = np.zeros(whole), np.zeros(whole)
    y = _begun(x, q, v, commands)
    told[0, 0], told[0, 1] = q, v
    for k in range(len(commands) * count):
        now, t = k // count, (k + 0.5) * h
        for i in range(whole):
            Q[i] += 0.5 * h * V[i]
        dynamics(chain[0], chain[1], chain[2], chain[3], chain[4], chain[5], Q, V, M, bias)
        right[:], damping[:], bound[:] = 0.0, 0.0, 0.0
        if s:
            right[0], damping[0] = -stand[0] * Q[0], stand[1]
        if coupling != 0.0:
            taut = coupling * (Q[whole - 1] - Q[whole - 2])
            right[whole - 1] -= taut
            right[whole - 2] += taut
        for i in range(n):
            u = command(x, y, i, commands, t, period, 0.5 * h)  # in the middle of the step
            command(x, y, i, commands, t, period, 0.5 * h)  # and at its end
            given = _driven(x, y, heat, i, u, Q[i + s], V[i + s], told, k, power[now], enabled[now], h)
            given += push[now, i]
            emf = x[BACK_EMF, i] if enabled[now] > 0.5 else 0.0
            _act(
                x,
                y,
                i,
                s,
                given,
                emf,
                x[LIMIT, i] * power[now],
                begin + t,
                k,
                h,
                Q,
                V,
                M,
                bias,
                right,
                damping,
                bound,
            )
        for i in range(whole):
            right[i] = h * (right[i] - bias[i] - damping[i] * V[i])
            M[i, i] += 0.5 * h * damping[i]
        invert(M, inverse, column)
        for i in range(whole):
            for j in range(whole):
                V[i] += inverse[i, j] * right[j]
        stop(V, inverse, bound, impulse)
        for i in range(whole):
            Q[i] += 0.5 * h * V[i]
        for i in range(n):
            motors = _loose(x, i) and x[MOTOR_SIDE, i] > 0.5
            told[k + 1, 0, i] = y[THETA, i] if motors else Q[i + s]
            told[k + 1, 1, i] = y[OMEGA, i] if motors else V[i + s]


def _loose(x, i):
    return x[GAP, i] > 0.0 or x[COMPLIANCE, i] > 0.0


def reading(x, i, angle):
    """[rad] what the encoder of joint i says at an angle [rad]; of all joints (..., n) where i is a slice."""
    wobble = x[ECCENTRIC, i] * np.sin(angle) + x[ECCENTRIC_COSINE, i] * np.cos(angle)
    return x[SCALE, i] * (angle + x[OFFSET, i]) + wobble


def read_speed(x, i, angle, rate):
    """[rad/s] what it says of a speed there."""
    slope = x[ECCENTRIC, i] * np.cos(angle) - x[ECCENTRIC_COSINE, i] * np.sin(angle)
    return (x[SCALE, i] + slope) * rate


def _begun(x, q, v, commands):
    """(STATE, n) at the start."""
    y = np.zeros((len(STATE), len(q)))
    y[THETA], y[OMEGA] = q, v
    for i in range(len(q)):
        y[SMOOTH, i] = commands[0, i] * x[COMMAND_GAIN, i]
        y[LIMITED, i] = y[PROFILE, i] = reading(x, i, q[i])
    return y


def _driven(x, y, heat, i, u, q, v, told, k, power, enabled, h):
    """[N m] of motor i for a command u [rad], at the joint's angle and speed."""
    loose = _loose(x, i)
    if loose:
        y[THETA, i] += 0.5 * h * y[OMEGA, i]
    angle, rate = (y[THETA, i], y[OMEGA, i]) if loose and x[MOTOR_SIDE, i] > 0.5 else (q, v)
    if x[FEEDBACK_DELAY, i] > 0.0:
        old = max(k - int(np.rint(x[FEEDBACK_DELAY, i] / h)), 0)
        angle, rate = told[old, 0, i], told[old, 1, i]
    on = 1.0 if enabled > 0.5 else 0.0
    given = servo(x, y, i, u - reading(x, i, angle), read_speed(x, i, angle, rate), power, on, h)
    turns = y[OMEGA, i] if loose and x[EMF_OUTSIDE, i] < 0.5 else v
    return motor(
        x, heat, i, given, y[THETA, i] if loose else q, turns, on * x[BACK_EMF, i], x[LIMIT, i] * power, h
    )


def _act(x, y, i, s, given, emf, limit, time, k, h, Q, V, M, bias, right, damping, bound):
    """Write what motor i, its gear and its friction do to joint i + s: torque, damping, dry friction, inertia."""
    j, loose = i + s, _loose(x, i)
    turns = y[OMEGA, i] if loose and x[EMF_OUTSIDE, i] < 0.5 else V[j]
    most = dry(x, i, Q[j], V[j], given, given - emf * turns, bias[j], limit, time)
    damping[j] += x[VISCOUS, i]
    if x[BEND, i] > 0.0:
        torque, fine = bristles(x, y, i, V[j], most, M[j, j], h)
        right[j] -= torque
        damping[j] += fine
    else:
        bound[j] = h * most
    if loose:
        if k == 0:
            Q[j] = laid(x, y, i, Q[j], given, h)
        torque, behind = passed(x, y, i, Q[j], V[j], given, emf, h)
        right[j] += torque
        damping[j] += behind
        M[j, j] += (1.0 - ROTOR) * x[ARMATURE, i]
    else:
        right[j] += given
        damping[j] += emf
        M[j, j] += x[ARMATURE, i]
