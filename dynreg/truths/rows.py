"""What a driven joint has: the rows of the small table that truths' kernels read, and of the state that they keep."""

import numpy as np

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
    "scale",  # of the encoder: reading = scale (q + offset) + eccentric sin(q) + eccentric_cosine cos(q)
    "offset",
    "eccentric",
    "eccentric_cosine",
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
    "patch",  # N m, dry, at its worst place
    "patch_at",  # rad
    "patch_wide",  # rad
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
    ECCENTRIC_COSINE,
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
    PATCH,
    PATCH_AT,
    PATCH_WIDE,
    BEND,
    GAP,
    COMPLIANCE,
    MOTOR_SIDE,
    EMF_OUTSIDE,
) = range(len(ROWS))
# (rows, joints) of what goes on from step to step
STATE = (
    "theta",  # rad, of the motor
    "omega",  # rad/s
    "smooth",  # command after a lag
    "limited",  # command after a rate limit
    "profile",  # rad, of a trapezoid's way
    "pace",  # rad/s
    "torque",  # N m, after a lag
    "bristle",  # rad
)
THETA, OMEGA, SMOOTH, LIMITED, PROFILE, PACE, TORQUE, BRISTLE = range(len(STATE))


def plain(n: int) -> np.ndarray:
    """(rows, n) of joints without drives, friction and causes."""
    x = np.zeros((len(ROWS), n))
    for row in (SCALE, COMMAND_GAIN, FADES, LIMIT, PATCH_WIDE):
        x[row] = 1.0
    for row in (RATE_LIMIT, PROFILE_SPEED, PROFILE_ACCELERATION, NO_LOAD_SPEED):
        x[row] = np.inf
    return x
