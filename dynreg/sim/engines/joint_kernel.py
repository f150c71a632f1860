"""The joint engine's integrator: `compiling` hands this text to numba, with the servo law and the ports of effects.

Every joint is a column of a small table `x`, whose rows have names. The columns of a block have the same effects and as
many time steps in a command; commands before the run are known of all of them, or of none.
"""

import numpy as np

# Columns of a block: the time steps of different joints overlap in the processor. 1, 4, 8, 16, 64: 29, 46, 55, 57 and
# 59 million time steps/s of servo_pendulum's law with Stribeck and load friction, on one core.
WIDTH = 16

# Where rows begin. The engine gives those of the drive and its encoder, of what it moves, of time, and its state.
(GAIN, RATE_GAIN, TORQUE_LIMIT, SPEED_LIMIT, DUTY_GAIN, KT, RESISTANCE) = range(0, 7 * WIDTH, WIDTH)
(GAIN_FACTOR, LIMIT_FACTOR, IS_POSITION, IS_TORQUE, IS_DUTY_SERVO, IS_DCMOTOR, IS_SPEED) = range(
    7 * WIDTH, 14 * WIDTH, WIDTH
)
(SCALE, OFFSET, SUPPLY, INERTIA, VISCOUS, COULOMB, AMPLITUDE) = range(14 * WIDTH, 21 * WIDTH, WIDTH)
(PHASE, CONSTANT, H, PERIOD, BEGIN, AT, V) = range(21 * WIDTH, 28 * WIDTH, WIDTH)
(LOW, HIGH, SPRING, DAMPER, FIRMEST, SOFTEST, DEPTH, MIDDLE, POWER) = range(28 * WIDTH, 37 * WIDTH, WIDTH)
(BACK_EMF, DUTY_LIMIT, FIRST) = range(37 * WIDTH, 40 * WIDTH, WIDTH)
GIVEN = 40
# The others are computed: the law in force, what it makes of a time step, and what ports see.
(PUSH, STIFFNESS, RATE, LIMIT, FADE, DAMPING, BIAS, DRAG, KEPT) = range(40 * WIDTH, 49 * WIDTH, WIDTH)
(ON, DRAW, SENT, U, MEASURED, Q, TORQUE, NET, LOAD) = range(49 * WIDTH, 58 * WIDTH, WIDTH)
# What the encoder's shaft stands and turns ahead of the joint; what the drive's own loop sees; time steps so far.
(FRICTION, AFTER, AHEAD, FASTER, SEEN, SEEN_V, COUNT) = range(58 * WIDTH, 65 * WIDTH, WIDTH)
ROWS = 65
# What an encoder reads too much depends on where its joint is, and that on what it reads too much: a fixed point. After
# four turns a strong eccentricity is 5e-8 rad off, the most that a fit reaches (0.3 rad) 5e-3 rad.
SETTLED = 4

_ROUND = 6755399441055744.0  # added and taken off, it leaves the nearest integer


def sine(x):
    """np.sin without a branch, so that several joints are reckoned at once: a third of the time; 2e-16 off at most.

    Its series about the nearest multiple of pi, which is taken off in three parts (Cody and Waite); 0 beyond 1e9.
    """
    n = (x * 0.3183098861837907 + _ROUND) - _ROUND
    odd = abs(n - 2.0 * ((0.5 * n + _ROUND) - _ROUND))
    r = ((x - n * 3.14159250259399414062) - n * 1.509957883172319270672e-07) - n * 1.07806057163162380e-14
    r = 0.0 if abs(x) > 1e9 else r
    s = r * r
    p = 1.0 / 51090942171709440000.0
    p = p * s - 1.0 / 121645100408832000.0
    p = p * s + 1.0 / 355687428096000.0
    p = p * s - 1.0 / 1307674368000.0
    p = p * s + 1.0 / 6227020800.0
    p = p * s - 1.0 / 39916800.0
    p = p * s + 1.0 / 362880.0
    p = p * s - 1.0 / 5040.0
    p = p * s + 1.0 / 120.0
    p = p * s - 1.0 / 6.0
    return (r + r * s * p) * (1.0 - 2.0 * odd)


def exponential(x):
    """np.exp in the same way: 2 to the nearest power, times the series of what is left; 0 or infinite beyond 700."""
    near = abs(x) < 700.0
    z = x if near else 0.0
    n = (z * 1.4426950408889634 + _ROUND) - _ROUND
    r = (z - n * 0.693145751953125) - n * 1.42860682030941723212e-6
    p = 1.0 / 6227020800.0
    p = p * r + 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = (p * r + 1.0) * np.int64((np.int64(n) + 1023) << 52).view(np.float64)
    far = np.inf if x > 0.0 else 0.0
    return p if near else x if x != x else far


def law(x, n):
    """Write the servo law of n columns; traced."""


def command(x, kinds, places, n, first, commands, sims, drives, step, substep, trail):
    """Let the effects on commands change the row U; traced.

    So are `drive`, of TORQUE, `friction`, `feedback`, of SEEN and SEEN_V, and `encoder`, of AHEAD and FASTER. first : 1
    in the first time step, 2 where effects that recall have begun before it, else 0.
    """


drive = friction = feedback = encoder = command


def ago(trail, k, count, steps, h, what):
    """What the encoder of column k said so many time steps before time step `count`; what 0: angle, 1: speed.

    Between two time steps in proportion; before the first one it turned on at its first speed. trail : (N, 2, WIDTH),
    the first time step, then the last N - 1 in turn.
    """
    at = count - steps
    if at <= 0.0:
        return trail[0, 0, k] + at * h * trail[0, 1, k] if what == 0 else trail[0, 1, k]
    kept = trail.shape[0] - 1
    at = max(at, count - kept + 1.0)
    low = int(at)
    share = at - low
    before = trail[1 + low % kept, what, k]
    return before + share * (trail[1 + (low + 1) % kept, what, k] - before) if share > 0.0 else before


def remember(x, n, trail):
    """Write what the encoders of n columns say into their trail."""
    kept = trail.shape[0] - 1
    place = 1 + int(x[COUNT]) % kept
    for k in range(n):
        trail[place, 0, k], trail[place, 1, k] = x[SEEN + k], x[SEEN_V + k]
        if x[COUNT] == 0.0:
            trail[0, 0, k], trail[0, 1, k] = x[SEEN + k], x[SEEN_V + k]


def obey(x, n):
    """What the law makes of a time step. Damping is the mean of before and after."""
    law(x, n)
    for k in range(n):
        damping = x[H + k] * (x[VISCOUS + k] + x[DAMPING + k])
        after = 0.5 if damping < x[INERTIA + k] else 1.0  # very strong damping: all of it afterwards
        x[DRAG + k] = x[INERTIA + k] + after * damping
        x[KEPT + k] = x[INERTIA + k] - (1.0 - after) * damping


def listen(x, n, inputs, heard, sims, drives, step):
    """Hear supply and enable channels of n columns; whether any of them changed."""
    changed = step == 0
    for k in range(n):
        supply, enable = heard[0, drives[k]], heard[1, drives[k]]
        if supply >= 0:
            volt = inputs[sims[k], step, supply]
            changed = changed or volt != x[SUPPLY + k]
            x[SUPPLY + k] = volt
        on = 1.0 if enable < 0 or inputs[sims[k], step, enable] >= 0.5 else 0.0
        changed = changed or on != x[ON + k]
        x[ON + k] = on
    return changed


def press(x, n):
    """Let the stops push back joints that are beyond them, as MuJoCo's do: a spring, a damper and an impedance.

    The joint's acceleration is that share of the stop's own; it is never pulled.
    """
    for k in range(n):
        low = x[Q + k] < x[LOW + k]
        if low or x[Q + k] > x[HIGH + k]:
            inward = 1.0 if low else -1.0
            depth = x[LOW + k] - x[Q + k] if low else x[Q + k] - x[HIGH + k]
            y = min(depth / x[DEPTH + k], 1.0)
            m, power = x[MIDDLE + k], x[POWER + k]
            y = (
                y**power / m ** (power - 1.0)
                if y <= m
                else 1.0 - (1.0 - y) ** power / (1.0 - m) ** (power - 1.0)
            )
            share = x[SOFTEST + k] + y * (x[FIRMEST + k] - x[SOFTEST + k])
            back = share * x[SPRING + k] * depth - x[DAMPER + k] * inward * x[V + k]
            pushed = (1.0 - share) * inward * x[AFTER + k]
            pushed += share * (inward * x[V + k] + x[H + k] * back)
            x[AFTER + k] = inward * max(inward * x[AFTER + k], pushed)


def turn(x, kinds, places, n, first, commands, sims, drives, step, substep, trail):
    """Let encoders that do not sit on the joint say how far ahead of it their shafts stand, and turn."""
    for k in range(n):
        x[AHEAD + k] = x[FASTER + k] = 0.0
    encoder(x, kinds, places, n, first, commands, sims, drives, step, substep, trail)


def advance(x, n, kinds, places, apart, first, commands, sims, drives, step, substep, trail):
    """One time step by leapfrog: half a step of position, a step of velocity, half a step of position.

    It is of second order, and stable. Dry friction is the impulse that stops the joint, at most its bound (exact for
    one joint: it neither creeps nor chatters). A first-order step would move the joint half a time step early, and a
    diagnosis would blame a cause for it.

    apart : whether the loop of some drive sees something else than the joint now. At first, encoders say where their
    shafts stand, and the joints are moved to where they are then.
    """
    for k in range(n):
        x[Q + k] = x[AT + k] + 0.5 * x[H + k] * x[V + k]
        x[U + k] = x[SENT + k]
        x[SEEN + k], x[SEEN_V + k] = x[Q + k], x[V + k]
    if apart:
        for k in range(n):
            x[SEEN + k] += x[AHEAD + k]
            x[SEEN_V + k] += x[FASTER + k]
        remember(x, n, trail)
        feedback(x, kinds, places, n, first, commands, sims, drives, step, substep, trail)
    for k in range(n):
        x[MEASURED + k] = x[SCALE + k] * (x[SEEN + k] + x[OFFSET + k])
    command(x, kinds, places, n, first, commands, sims, drives, step, substep, trail)
    for k in range(n):
        push = x[PUSH + k] * x[U + k] + x[BIAS + k]
        torque = push - x[STIFFNESS + k] * x[SEEN + k] - x[RATE + k] * x[SEEN_V + k]
        slower = x[FADE + k] * x[V + k]
        low = -x[LIMIT + k] * np.minimum(np.maximum(1.0 + slower, 0.0), 1.0)
        high = x[LIMIT + k] * np.minimum(np.maximum(1.0 - slower, 0.0), 1.0)
        x[TORQUE + k] = np.minimum(np.maximum(torque, low), high)
    if apart and first:
        for k in range(n):
            x[AFTER + k] = x[V + k]  # as it was read
        for _ in range(SETTLED):
            turn(x, kinds, places, n, first, commands, sims, drives, step, substep, trail)
            for k in range(n):
                x[Q + k] = x[AT + k] + 0.5 * x[H + k] * x[AFTER + k] - x[AHEAD + k]
                x[V + k] = x[AFTER + k] - x[FASTER + k]
    for k in range(n):
        x[LOAD + k] = x[AMPLITUDE + k] * sine(x[Q + k] + x[PHASE + k]) + x[CONSTANT + k]
    drive(x, kinds, places, n, first, commands, sims, drives, step, substep, trail)
    for k in range(n):
        # what the gear carries: a motor's back-EMF takes its share
        x[NET + k] = x[TORQUE + k] - x[DAMPING + k] * x[V + k]
        x[FRICTION + k] = x[COULOMB + k]
    friction(x, kinds, places, n, first, commands, sims, drives, step, substep, trail)
    for k in range(n):
        after = (x[KEPT + k] * x[V + k] + x[H + k] * (x[TORQUE + k] - x[LOAD + k])) / x[DRAG + k]
        stop = x[H + k] * x[FRICTION + k] / x[DRAG + k]
        after -= np.minimum(np.maximum(after, -stop), stop)  # what is left beyond what friction stops
        x[AFTER + k] = after
    beyond = 0
    for k in range(n):
        beyond += (x[Q + k] < x[LOW + k]) | (x[Q + k] > x[HIGH + k])
    if beyond:
        press(x, n)
    for k in range(n):
        x[V + k] = x[AFTER + k]
        x[AT + k] = x[Q + k] + 0.5 * x[H + k] * x[AFTER + k]
    if apart:
        for k in range(n):
            x[COUNT + k] += 1.0
        turn(x, kinds, places, n, 0, commands, sims, drives, step, substep, trail)


def load(x, n, joints, given, own, terms, sizes, places):
    """Write what n joints are given into x, and the rows of their own that effects have; their first to `places`."""
    for k in range(n):
        for row in range(GIVEN):
            x[row * WIDTH + k] = given[row, joints[k]]
        at = ROWS
        for j in range(len(terms)):
            places[j] = at * WIDTH
            for row in range(sizes[terms[j, 0]]):
                x[(at + row) * WIDTH + k] = own[terms[j, 1] + row, joints[k]]
            at += sizes[terms[j, 0]]


def recall(x, kinds, places, recalling, n, commands, sims, drives, substeps, told, trail):
    """Let effects remember the last `told` commands, those before the run; joints are taken to have stood on the first.

    recalling : 0 for kinds that look at more, 2 for those that remember. Whether there was something to remember.
    """
    telling, remembers = np.empty(len(kinds), np.int64), False
    for j in range(len(kinds)):
        telling[j] = kinds[j] if recalling[kinds[j]] else -1
        remembers = remembers or recalling[kinds[j]] == 2
    if not remembers or x[FIRST] == 0.0:
        return False
    for k in range(n):
        x[MEASURED + k], x[AFTER + k], x[V + k] = commands[sims[k], -told, drives[k]], x[V + k], 0.0
    first = 1
    for step in range(-told, 0):
        for substep in range(substeps):
            for k in range(n):
                x[U + k] = commands[sims[k], step, drives[k]]
            command(x, telling, places, n, first, commands, sims, drives, step, substep, trail)
            first = 0
    for k in range(n):
        x[V + k] = x[AFTER + k]
    return True


def run(
    blocks,
    order,
    terms,
    sizes,
    looking,
    recalling,
    back,
    given,
    own,
    inputs,
    heard,
    commands,
    draws,
    positions,
    velocities,
):
    """Integrate the joints of some blocks.

    blocks : (K, 5) begin and end in `order`, begin and end in `terms`, time steps in a command. order : numbers of
    joints, simulation times drives + drive. terms : (M, 2) kind of an effect, and its first row in `own`. sizes : rows
    of each kind. looking : whether each changes what a drive's loop or the log sees. recalling : as in `recall`. back :
    [s] that a loop looks back. given (GIVEN, J) and own (R, J) : of J joints. inputs : (N, T, I), of which a drive
    hears the channels heard (2, A), supply and enable; -1 for none. commands (N, T + L, A) : of the run, then the L
    told before it, so that -1 is the last of these; the row FIRST has the number of the first that is known.
    draws : (N, T, A). positions, velocities : (N, T+1, A), written.
    """
    count, most = commands.shape[2], 0
    for begin, end in blocks[:, 2:4]:
        rows = 0
        for kind, _ in terms[begin:end]:
            rows += sizes[kind]
        most = max(most, rows)
    x = np.zeros((ROWS + most) * WIDTH)
    for lowest, highest, begin, end, substeps in blocks:
        n = highest - lowest
        joints = order[lowest:highest]
        sims, drives = joints // count, joints % count
        kinds, places = terms[begin:end, 0], np.empty(end - begin, np.int64)
        load(x, n, joints, given, own, terms[begin:end], sizes, places)
        for k in range(n):
            positions[sims[k], 0, drives[k]], velocities[sims[k], 0, drives[k]] = x[AT + k], x[V + k]
        apart, kept = False, 1
        for j in range(end - begin):
            apart = apart or looking[kinds[j]] != 0
        if apart:
            for k in range(n):
                kept = max(kept, int(np.ceil(back / x[H + k])) + 2)
                x[AHEAD + k] = x[FASTER + k] = x[COUNT + k] = 0.0
        trail = np.zeros((1 + kept, 2, WIDTH))
        told = commands.shape[1] - positions.shape[1] + 1
        recalled = recall(x, kinds, places, recalling, n, commands, sims, drives, substeps, told, trail)
        for step in range(positions.shape[1] - 1):
            if listen(x, n, inputs, heard, sims, drives, step):
                obey(x, n)
            for k in range(n):
                x[SENT + k] = commands[sims[k], step, drives[k]]
            if draws.shape[1]:
                for k in range(n):
                    x[DRAW + k] = draws[sims[k], step, drives[k]]
            for substep in range(substeps):
                first = (2 if recalled else 1) if step == 0 and substep == 0 else 0
                advance(x, n, kinds, places, apart, first, commands, sims, drives, step, substep, trail)
            for k in range(n):
                positions[sims[k], step + 1, drives[k]] = x[AT + k]
                velocities[sims[k], step + 1, drives[k]] = x[V + k]
            if apart:  # the log holds what the encoders say
                for k in range(n):
                    ahead = x[AHEAD + k] - 0.5 * x[H + k] * x[FASTER + k]  # half a time step before
                    positions[sims[k], step + 1, drives[k]] += ahead
                    velocities[sims[k], step + 1, drives[k]] += x[FASTER + k]
