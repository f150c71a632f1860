"""A base on two wheels: speed and yaw rate follow what the wheels are told, by Runge and Kutta's rule.

`kernels` compiles it.
"""

import numpy as np

CENTRIFUGAL, COUPLING = 1.17e-8, 6.0e-6  # the two small ones of the model's six (Pretorius et al., Table II)
ENDLESS = 1e9
ROWS = (
    "radius",  # m
    "track",  # m
    "speed_lag",  # s
    "yaw_lag",
    "speed_drag",
    "yaw_drag",
    "scale",  # of the encoders
    "difference",  # right - left gain, relative
    "gain",
    "deadband",  # rad/s
    "delay",  # s
    "lag",  # s
    "second_lag",  # s
    "rate_limit",  # rad/s^2
    "grip",  # m/s^2
    "creep",  # s
    "arm",  # m
    "eccentric",  # of the right wheel's radius
)
(
    RADIUS,
    TRACK,
    SPEED_LAG,
    YAW_LAG,
    SPEED_DRAG,
    YAW_DRAG,
    SCALE,
    DIFFERENCE,
    GAIN,
    DEADBAND,
    DELAY,
    LAG,
    SECOND_LAG,
    RATE_LIMIT,
    GRIP,
    CREEP,
    ARM,
    ECCENTRIC,
) = range(len(ROWS))


def drive(x, commands, period, count, begin, trace):
    """Write the readings (T count + 1, 7) of a base that is told wheel speeds `commands` (T, 2) [rad/s].

    begin : (7,) readings at the start: left and right angle and speed of the wheels, x, y, yaw.
    """
    h = period / count
    radius, track, scale = x[RADIUS], x[TRACK], x[SCALE]
    left, right = begin[2] / scale, begin[3] / scale
    y = np.zeros(7)  # speed, yaw rate, x, y, yaw, angles of the wheels
    y[0], y[1] = 0.5 * radius * (left + right), radius * (right - left) / track
    y[2], y[3], y[4], y[5], y[6] = begin[4], begin[5], begin[6], begin[0] / scale, begin[1] / scale
    ground = np.array([radius * left, radius * right])
    smooth, second = commands[0] * (1.0 + x[GAIN]), np.array([left, right]) * scale
    limited = np.array([left, right]) * scale
    stages, at, u, unused = np.zeros((4, 7)), np.zeros(7), np.zeros(2), np.zeros(2)
    _write(trace, 0, y, x)
    for k in range(len(commands) * count):
        now = max(int(np.floor(((k + 0.5) * h - x[DELAY]) / period)), 0)
        # what acts in the middle of the step, and what the next one finds
        _obey(x, commands[now], smooth, limited, second, u, 0.5 * h)
        _obey(x, commands[now], smooth, limited, second, unused, 0.5 * h)
        wanted = 0.5 * radius * (u[0] + u[1])
        turned = radius * (u[1] - u[0]) / track
        before = y.copy()
        for stage in range(4):
            share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for j in range(7):
                at[j] = y[j] + (share * h * stages[stage - 1, j] if stage else 0.0)
            v, w = at[0], at[1]
            stages[stage, 0] = (wanted - x[SPEED_DRAG] * v + CENTRIFUGAL * w * w) / x[SPEED_LAG]
            stages[stage, 1] = (turned - x[YAW_DRAG] * w - COUPLING * v * w) / x[YAW_LAG]
            # a wheel that is out of true rolls further on one half of its turn
            of_right = (v + 0.5 * w * track) * (1.0 + x[ECCENTRIC] * np.sin(at[6]))
            of_left = v - 0.5 * w * track
            stages[stage, 2] = 0.5 * (of_left + of_right) * np.cos(at[4])
            stages[stage, 3] = 0.5 * (of_left + of_right) * np.sin(at[4])
            stages[stage, 4] = (of_right - of_left) / track
            stages[stage, 5] = (v - 0.5 * w * track) / radius
            stages[stage, 6] = (v + 0.5 * w * track) / radius
        for j in range(7):
            y[j] += h / 6.0 * (stages[0, j] + 2.0 * stages[1, j] + 2.0 * stages[2, j] + stages[3, j])
        if x[GRIP] < ENDLESS or x[CREEP] > 0.0:
            _slide(x, y, before, ground, h)
        _write(trace, k + 1, y, x)


def _obey(x, told, smooth, limited, second, u, h):
    """Write the speeds u (2,) [rad/s] that the drives ask of their wheels; (2,) lags and limits go on."""
    for i in range(2):
        u[i] = told[i] * (1.0 + x[GAIN])
        if x[LAG] > 0.0:
            smooth[i] += (1.0 - np.exp(-h / x[LAG])) * (u[i] - smooth[i])
            u[i] = smooth[i]
        if x[RATE_LIMIT] < ENDLESS:
            reach = x[RATE_LIMIT] * h
            limited[i] += min(max(u[i] - limited[i], -reach), reach)
            u[i] = limited[i]
        u[i] -= min(max(u[i], -x[DEADBAND]), x[DEADBAND])
        if x[SECOND_LAG] > 0.0:
            second[i] += (1.0 - np.exp(-h / x[SECOND_LAG])) * (u[i] - second[i])
            u[i] = second[i]
        u[i] /= x[SCALE]  # wheels are driven to what their encoders read
    if x[ARM] > 0.0:
        speed, turn = 0.5 * x[SCALE] * (u[0] + u[1]), x[SCALE] * (u[1] - u[0]) / x[TRACK]
        lost = np.sign(speed) * min(x[ARM] * abs(turn), abs(speed)) / x[SCALE]
        u[0] -= lost
        u[1] -= lost
    u[0] *= 1.0 - 0.5 * x[DIFFERENCE]
    u[1] *= 1.0 + 0.5 * x[DIFFERENCE]


def _slide(x, y, before, ground, h):
    """Let the pose in y (7,) follow what the ground takes of the wheels' speeds: ground (2,) [m/s] goes on."""
    for i in range(2):
        rolls = y[0] + (i - 0.5) * x[TRACK] * y[1]
        if x[CREEP] > 0.0:
            ground[i] += (1.0 - np.exp(-h / x[CREEP])) * (rolls - ground[i])
        else:
            reach = x[GRIP] * h
            ground[i] += min(max(rolls - ground[i], -reach), reach)
    heading = before[4] + 0.5 * h * (ground[1] - ground[0]) / x[TRACK]
    y[2] = before[2] + 0.5 * h * (ground[0] + ground[1]) * np.cos(heading)
    y[3] = before[3] + 0.5 * h * (ground[0] + ground[1]) * np.sin(heading)
    y[4] = before[4] + h * (ground[1] - ground[0]) / x[TRACK]


def _write(trace, k, y, x):
    trace[k, 0], trace[k, 1] = x[SCALE] * y[5], x[SCALE] * y[6]
    trace[k, 2] = x[SCALE] * (y[0] - 0.5 * x[TRACK] * y[1]) / x[RADIUS]
    trace[k, 3] = x[SCALE] * (y[0] + 0.5 * x[TRACK] * y[1]) / x[RADIUS]
    trace[k, 4], trace[k, 5], trace[k, 6] = y[2], y[3], y[4]
