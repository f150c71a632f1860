"""Driven joints of a chain under commands: drives, friction, gears and encoders, 0.1 ms at a time.

Position half a step, velocity a step, position half a step. Dry friction is the impulse that stops the joints, at most
its bound in each (Gauss and Seidel over the joints); bristles are forces with a state of their own. Joints with play
or a soft gear have a motor of their own.
"""

import numpy as np
from numba import njit

from dynreg.truths.chain import dynamics

STEP = 1e-4  # s
ROTOR = 0.5  # of the reflected inertia that turns with the motor: by contract with robot folders
SWEEPS = 20  # over the joints, of dry friction: six coupled joints need 4 to 9
# (rows, joints) of what a joint has, by name
ROWS = (
    "gain",  # N m/rad, or N m where the command is a torque
    "rate_gain",  # N m s/rad
    "limit",  # N m
    "back_emf",  # N m s/rad, of the drive, off with it
    "armature",  # kg m^2
    "viscous",  # N m s/rad
    "lopsided",  # N m s/rad, against one way and for the other
    "coulomb",  # N m
    "scale",  # of the encoder: reading = scale (q + offset) + eccentric sin(q)
    "offset",
    "eccentric",
    "command_delay",  # s
    "command_gain",
    "command_lag",  # s
    "rate_limit",  # rad/s; infinite for none
    "deadband",  # rad
    "profile_speed",  # rad/s; infinite for none
    "profile_acceleration",  # rad/s^2
    "feedback_delay",  # s
    "torque_lag",  # s
    "no_load_speed",  # rad/s; infinite for none
    "sag",
    "fade",  # with one time constant
    "build_up",  # with two
    "ripple_sine",  # N m
    "ripple_cosine",
    "ripple_count",  # a turn
    "force",  # N m
    "drag",  # N m s^2/rad^2
    "load",  # friction per torque
    "load_extra",
    "load_growth",
    "extra",  # N m, near standstill
    "fades",  # rad/s
    "asymmetric",  # N m
    "drift",  # N m/s
    "bend",  # rad; 0 for dry friction without bristles
    "gap",  # rad
    "compliance",  # rad/(N m)
    "motor_side",  # 1 where the encoder sits on the motor
    "emf_outside",  # 1 where the back-EMF brakes the joint behind the gear, as the library has it
)
(
    GAIN,
    RATE_GAIN,
    LIMIT,
    BACK_EMF,
    ARMATURE,
    VISCOUS,
    LOPSIDED,
    COULOMB,
    SCALE,
    OFFSET,
    ECCENTRIC,
    COMMAND_DELAY,
    COMMAND_GAIN,
    COMMAND_LAG,
    RATE_LIMIT,
    DEADBAND,
    PROFILE_SPEED,
    PROFILE_ACCELERATION,
    FEEDBACK_DELAY,
    TORQUE_LAG,
    NO_LOAD_SPEED,
    SAG,
    FADE,
    BUILD_UP,
    RIPPLE_SINE,
    RIPPLE_COSINE,
    RIPPLE_COUNT,
    FORCE,
    DRAG,
    LOAD,
    LOAD_EXTRA,
    LOAD_GROWTH,
    EXTRA,
    FADES,
    ASYMMETRIC,
    DRIFT,
    BEND,
    GAP,
    COMPLIANCE,
    MOTOR_SIDE,
    EMF_OUTSIDE,
) = range(len(ROWS))
WARMS = 4.0  # s: of the library's one time constant, and of copper where there are two
COOLS = 60.0  # s: of the housing, which takes half of the heat
STILL = 1e-4  # rad/s below which a joint counts as at rest
CONTACT = 0.2  # of a flank's natural frequency times the time step: as hard as the step can follow
RING = 0.5  # damping ratio of gears


def plain(n: int) -> np.ndarray:
    """(rows, n) of joints without drives, friction and causes."""
    x = np.zeros((len(ROWS), n))
    for row in (SCALE, COMMAND_GAIN, FADES, LIMIT):
        x[row] = 1.0
    for row in (RATE_LIMIT, PROFILE_SPEED, PROFILE_ACCELERATION, NO_LOAD_SPEED):
        x[row] = np.inf
    return x


@njit(cache=True, error_model="numpy")
def episode(
    chain, x, stand, coupling, commands, power, enabled, push, period, step, begin, q, v, heat, told
):  # fmt: skip
    """Move the joints through commands (T, n), each held for `period` [s] of true time.

    chain : `Chain.parts`, of n joints and a stand's before them where stand (2,) [N m/rad, N m s/rad] is not 0.
    coupling : [N m/rad] of a cable between the last two joints. power (T,) : supply over nominal; enabled (T,);
    push (T, n) [N m] of disturbances. q, v (n,) at the start, changed; heat (2, n) of the motors, changed. told
    (T steps + 1, 2, n), written: angle and speed where the encoders sit, at every time step.
    """
    at, axis, mass, centre, inertia, gravity = chain
    n, whole = len(q), len(mass)
    s = whole - n
    count = int(np.rint(period / step))
    h = period / count
    Q, V = np.zeros(whole), np.zeros(whole)
    Q[s:], V[s:] = q, v
    M, bias = np.zeros((whole, whole)), np.zeros(whole)
    inverse, column = np.zeros((whole, whole)), np.zeros(whole)
    theta, omega = q.copy(), v.copy()  # of motors
    loose = (x[GAP] > 0) | (x[COMPLIANCE] > 0)
    seen, smooth, torque = np.zeros((2, n)), np.zeros(n), np.zeros(n)
    limited, speed = np.zeros(n), np.zeros(n)
    bristle, impulse = np.zeros(n), np.zeros(whole)
    bound, right, damping = np.zeros(whole), np.zeros(whole), np.zeros(whole)
    told[0, 0], told[0, 1] = q, v
    for i in range(n):
        reading = x[SCALE, i] * (q[i] + x[OFFSET, i]) + x[ECCENTRIC, i] * np.sin(q[i])
        smooth[i] = commands[0, i] * x[COMMAND_GAIN, i]
        limited[i] = reading
    for k in range(len(commands) * count):
        now = k // count
        t = (k + 0.5) * h
        for i in range(whole):
            Q[i] += 0.5 * h * V[i]
        dynamics(at, axis, mass, centre, inertia, gravity, Q, V, M, bias)
        for i in range(whole):
            damping[i] = right[i] = bound[i] = 0.0
        if s:
            right[0] -= stand[0] * Q[0]
            damping[0] = stand[1]
        if coupling != 0.0:
            taut = coupling * (Q[whole - 1] - Q[whole - 2])
            right[whole - 1] -= taut
            right[whole - 2] += taut
        for i in range(n):
            j = i + s
            if loose[i]:
                theta[i] += 0.5 * h * omega[i]
            angle, rate = (theta[i], omega[i]) if loose[i] and x[MOTOR_SIDE, i] else (Q[j], V[j])
            # what the drive sees
            back = x[FEEDBACK_DELAY, i]
            if back > 0.0:
                old = max(k - int(np.rint(back / h)), 0)
                angle, rate = told[old, 0, i], told[old, 1, i]
            reading = x[SCALE, i] * (angle + x[OFFSET, i]) + x[ECCENTRIC, i] * np.sin(angle)
            # the command on its way
            u = commands[max(int(np.floor((t - x[COMMAND_DELAY, i]) / period)), 0), i] * x[COMMAND_GAIN, i]
            if x[COMMAND_LAG, i] > 0.0:
                smooth[i] += (1.0 - np.exp(-h / x[COMMAND_LAG, i])) * (u - smooth[i])
                u = smooth[i]
            reach = x[RATE_LIMIT, i] * h
            limited[i] += min(max(u - limited[i], -reach), reach)
            if x[RATE_LIMIT, i] < np.inf:
                u = limited[i]
            if x[PROFILE_SPEED, i] < np.inf:
                # as fast as it may and can still brake
                gap = u - seen[0, i] if k else u - reading
                if k == 0:
                    seen[0, i] = reading
                most = min(x[PROFILE_SPEED, i], np.sqrt(2.0 * x[PROFILE_ACCELERATION, i] * abs(gap)))
                more = x[PROFILE_ACCELERATION, i] * h
                speed[i] += min(max(np.sign(gap) * most - speed[i], -more), more)
                seen[0, i] += h * speed[i]
                u = seen[0, i]
            error = u - reading
            error -= min(max(error, -x[DEADBAND, i]), x[DEADBAND, i])
            # the drive
            limit = x[LIMIT, i] * power[now]
            asked = 0.0
            if enabled[now] > 0.5:
                asked = x[GAIN, i] * power[now] * error - x[RATE_GAIN, i] * x[SCALE, i] * rate
            given = min(max(asked, -limit), limit)
            if x[TORQUE_LAG, i] > 0.0:
                torque[i] += (1.0 - np.exp(-h / x[TORQUE_LAG, i])) * (given - torque[i])
                given = torque[i]
            turning = omega[i] if loose[i] and x[EMF_OUTSIDE, i] < 0.5 else V[j]
            emf = x[BACK_EMF, i] if enabled[now] > 0.5 else 0.0
            if x[NO_LOAD_SPEED, i] < np.inf and given * turning > 0.0:
                room = limit * max(1.0 - abs(turning) / x[NO_LOAD_SPEED, i], 0.0)
                given = min(max(given, -room), room)
            given *= 1.0 - x[SAG, i] * min(abs(given - emf * turning) / limit, 1.0)
            warms = min((given / limit) ** 2, 1.0)
            heat[0, i] += h / WARMS * (warms - heat[0, i])
            heat[1, i] += h / COOLS * (heat[0, i] - heat[1, i])
            weak = x[FADE, i] * heat[0, i] + x[BUILD_UP, i] * (0.5 * heat[0, i] + 2.0 * heat[1, i])
            given *= max(1.0 - weak, 0.05)
            if x[RIPPLE_COUNT, i] > 0.0:
                turn = x[RIPPLE_COUNT, i] * (theta[i] if loose[i] else Q[j])
                given += x[RIPPLE_SINE, i] * np.sin(turn) + x[RIPPLE_COSINE, i] * np.cos(turn)
            given += x[FORCE, i] + push[now, i] - (x[DRAG, i] * turning + x[LOPSIDED, i]) * abs(turning)
            # friction
            carried = 0.5 * abs(given - emf * turning + bias[j])
            near = np.exp(-((V[j] / x[FADES, i]) ** 2))
            dry = x[COULOMB, i] + x[EXTRA, i] * near + x[DRIFT, i] * (begin + t)
            share = x[LOAD, i] + x[LOAD_EXTRA, i] * np.exp(-abs(V[j]) / x[FADES, i])
            dry += (share + x[LOAD_GROWTH, i] * min(carried / limit, 1.0)) * carried
            if x[ASYMMETRIC, i] != 0.0:
                way = V[j] if abs(V[j]) > STILL else given - bias[j]
                dry = max(dry + x[ASYMMETRIC, i] * np.sign(way), 0.0)
            damping[j] = x[VISCOUS, i]
            if x[BEND, i] > 0.0:
                stiff = x[COULOMB, i] / x[BEND, i]
                bristle[i] = (bristle[i] + h * V[j]) / (1.0 + h * abs(V[j]) * stiff / dry)
                # micro damping as strong as makes the stuck joint ring once
                fine = RING * np.sqrt(stiff * M[j, j]) * near
                right[j] -= stiff * bristle[i]
                damping[j] += fine
            else:
                bound[j] = h * dry
            # the gear
            if loose[i]:
                rotor = ROTOR * x[ARMATURE, i]
                hard = rotor * (CONTACT / h) ** 2
                if x[COMPLIANCE, i] > 0.0:
                    hard = min(1.0 / x[COMPLIANCE, i], hard)
                half = 0.5 * x[GAP, i]
                if k == 0:
                    # the joint was held before the log began: the gear lies on the side that is pushed
                    lies = half * np.sign(given) + given / hard
                    if x[MOTOR_SIDE, i] > 0.5:
                        Q[j] -= lies
                    else:
                        theta[i] += lies
                bent = theta[i] - Q[j]
                passed = 0.0
                if abs(bent) >= half:
                    bent -= np.sign(bent) * half
                    passed = hard * bent + 2.0 * RING * np.sqrt(hard * rotor) * (omega[i] - V[j])
                    if x[GAP, i] > 0.0 and passed * bent < 0.0:
                        passed = 0.0  # flanks push, they do not pull
                brakes = 0.0 if x[EMF_OUTSIDE, i] > 0.5 else emf
                omega[i] += h / (rotor + 0.5 * h * brakes) * (given - brakes * omega[i] - passed)
                damping[j] += emf - brakes
                theta[i] += 0.5 * h * omega[i]
                right[j] += passed
                M[j, j] += x[ARMATURE, i] - rotor
            else:
                right[j] += given
                damping[j] += emf
                M[j, j] += x[ARMATURE, i]
        for i in range(whole):
            right[i] = h * (right[i] - bias[i] - damping[i] * V[i])
            M[i, i] += 0.5 * h * damping[i]
        _invert(M, inverse, column)
        for i in range(whole):
            for j in range(whole):
                V[i] += inverse[i, j] * right[j]
        _stop(V, inverse, bound, impulse)
        for i in range(whole):
            Q[i] += 0.5 * h * V[i]
        for i in range(n):
            outside = loose[i] and x[MOTOR_SIDE, i] > 0.5
            told[k + 1, 0, i] = theta[i] if outside else Q[i + s]
            told[k + 1, 1, i] = omega[i] if outside else V[i + s]
    q[:], v[:] = Q[s:], V[s:]


@njit(cache=True, error_model="numpy")
def _invert(M, inverse, column):
    """Write the inverse of a positive definite M (n, n), whose lower half becomes its Cholesky factor."""
    n = len(M)
    for i in range(n):
        for j in range(i + 1):
            s = M[i, j]
            for k in range(j):
                s -= M[i, k] * M[j, k]
            M[i, j] = np.sqrt(s) if i == j else s / M[j, j]
    for c in range(n):
        for i in range(n):
            s = 1.0 if i == c else 0.0
            for k in range(i):
                s -= M[i, k] * column[k]
            column[i] = s / M[i, i]
        for i in range(n - 1, -1, -1):
            s = column[i]
            for k in range(i + 1, n):
                s -= M[k, i] * column[k]
            column[i] = s / M[i, i]
            inverse[i, c] = column[i]


@njit(cache=True, error_model="numpy")
def _stop(V, inverse, bound, impulse):
    """Let dry friction take off speeds V (n,) what it can: impulses (n,) within +-bound, those of before to begin with."""
    n = len(V)
    for i in range(n):
        impulse[i] = min(max(impulse[i], -bound[i]), bound[i])
        for j in range(n):
            V[j] += inverse[j, i] * impulse[i]
    for _ in range(SWEEPS):
        moved = 0.0
        for i in range(n):
            if bound[i] == 0.0:
                continue
            after = min(max(impulse[i] - V[i] / inverse[i, i], -bound[i]), bound[i])
            change = after - impulse[i]
            if change != 0.0:
                impulse[i] = after
                for j in range(n):
                    V[j] += inverse[j, i] * change
                moved = max(moved, abs(change) * inverse[i, i])
        if moved < 1e-9:
            break
