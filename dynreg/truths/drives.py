"""From a command to the torque of a motor: what happens on the way, in a servo's law and in the motor.

`kernels` compiles it.
"""

import numpy as np

from dynreg.truths.rows import (
    BUILD_UP,
    COMMAND_DELAY,
    COMMAND_GAIN,
    COMMAND_LAG,
    DEADBAND,
    DRAG,
    FADE,
    FORCE,
    GAIN,
    LIMIT,
    LIMITED,
    LOPSIDED,
    NO_LOAD_SPEED,
    OFFSET,
    PACE,
    PROFILE,
    PROFILE_ACCELERATION,
    PROFILE_SPEED,
    RATE_GAIN,
    RATE_LIMIT,
    RIPPLE_COSINE,
    RIPPLE_COUNT,
    RIPPLE_SINE,
    SAG,
    SMOOTH,
    TORQUE,
    TORQUE_LAG,
)

WARMS = 4.0  # s: of the library's one time constant, and of copper where there are two
COOLS = 60.0  # s: of the housing, which takes half of the heat
WEAKEST = 0.05  # of its torque keeps a motor however hot: by contract


def command(x, y, i, commands, t, period, h):
    """[rad] the command of joint i, h [s] after the last one, with its delay, gain, lag, rate limit and profile.

    Moves the states of lag, limit and profile on.

    t : [s] a moment in between.
    """
    u = commands[max(int(np.floor((t - x[COMMAND_DELAY, i]) / period)), 0), i] * x[COMMAND_GAIN, i]
    if x[COMMAND_LAG, i] > 0.0:
        y[SMOOTH, i] += (1.0 - np.exp(-h / x[COMMAND_LAG, i])) * (u - y[SMOOTH, i])
        u = y[SMOOTH, i]
    if x[RATE_LIMIT, i] < np.inf:
        reach = x[RATE_LIMIT, i] * h
        y[LIMITED, i] += min(max(u - y[LIMITED, i], -reach), reach)
        u = y[LIMITED, i]
    if x[PROFILE_SPEED, i] < np.inf:
        # as fast as it may and can still brake
        gap = u - y[PROFILE, i]
        most = min(x[PROFILE_SPEED, i], np.sqrt(2.0 * x[PROFILE_ACCELERATION, i] * abs(gap)))
        more = x[PROFILE_ACCELERATION, i] * h
        y[PACE, i] += min(max(np.sign(gap) * most - y[PACE, i], -more), more)
        if gap * y[PACE, i] > 0.0 and abs(h * y[PACE, i]) > abs(gap):
            y[PACE, i] = gap / h  # there within the step
        y[PROFILE, i] += h * y[PACE, i]
        u = y[PROFILE, i]
    return u


def servo(x, y, i, error, rate, power, on, h):
    """[N m] what a servo asks and the current brings, for an error [rad] and a rate [rad/s] as its encoder reads."""
    error -= min(max(error, -x[DEADBAND, i]), x[DEADBAND, i])
    limit = x[LIMIT, i] * power
    asked = on * (x[GAIN, i] * power * error - x[RATE_GAIN, i] * rate)
    given = min(max(asked, -limit), limit)
    if x[TORQUE_LAG, i] > 0.0:
        last, half = y[TORQUE, i], np.exp(-0.5 * h / x[TORQUE_LAG, i])
        y[TORQUE, i] = given + half * half * (last - given)
        given += half * (last - given)  # in the middle of the step
    return given


def motor(x, heat, i, given, angle, turning, emf, limit, h):
    """[N m] what a motor makes of it at an angle [rad] and a speed [rad/s]; heat (2, n) goes on."""
    if x[NO_LOAD_SPEED, i] < np.inf and given * turning > 0.0:
        room = limit * max(1.0 - abs(turning) / x[NO_LOAD_SPEED, i], 0.0)
        given = min(max(given, -room), room)
    given *= 1.0 - x[SAG, i] * min(abs(given - emf * turning) / limit, 1.0)
    heat[0, i] += h / WARMS * (min((given / limit) ** 2, 1.0) - heat[0, i])
    heat[1, i] += h / COOLS * (heat[0, i] - heat[1, i])
    weak = x[FADE, i] * heat[0, i] + x[BUILD_UP, i] * (0.5 * heat[0, i] + 2.0 * heat[1, i])
    given *= max(1.0 - weak, WEAKEST)
    if x[RIPPLE_COUNT, i] > 0.0:
        turn = x[RIPPLE_COUNT, i] * (angle + x[OFFSET, i])  # from the encoder's zero: by contract
        given += x[RIPPLE_SINE, i] * np.sin(turn) + x[RIPPLE_COSINE, i] * np.cos(turn)
    return given + x[FORCE, i] - (x[DRAG, i] * turning + x[LOPSIDED, i]) * abs(turning)
