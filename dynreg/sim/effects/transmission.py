"""Effects between motor and joint.

With `backlash` and `joint_elasticity` the encoder sits on the joint, and says nothing of the motor. With
`motor_backlash` and `motor_elasticity` it sits on the motor, and says nothing of the joint. With `cable_coupling` one
motor turns with two joints. The motor is a part of
the joint's reflected inertia (`armature`) and taken off it: the torque that reaches the joint is the drive's, plus what
the loose transmission passes, minus what a rigid one passes. So a transmission without play and compliance is the plain
model, to the bit.
"""

from typing import Any

import numpy as np

from dynreg.errors import quoted
from dynreg.sim.effects.body import driven_dofs, neighbours
from dynreg.sim.effects.effect import DEGREE, Effect, EffectParameter, Moment, Site, Values, drives
from dynreg.sim.ports import nominal_ports, takes_positions
from dynreg.sim.robot import Robot

ROTOR = 0.5  # of the joint's armature that turns with the motor, at least
COUPLED_SPEED = 0.01  # rad/s at which the friction of a coupled motor has three quarters of its torque
LIGHT = 0.02  # of the joint's inertia
RIGID = 0.2  # joint inertia / time step^2: stiffness of a rigid transmission, which the time step can follow


class _Transmission(Effect):
    """Splits the motor off the joint."""

    acts_on = "transmission"

    def configure(self, site: Site, p: Values) -> None:
        armature = site.expand("dof_armature")[site.rows]  # parameters set it too
        site.memory["rotor"] = ROTOR * armature[:, driven_dofs(site.robot)[site.joints]]


class _OnMotor(_Transmission):
    """The encoder sits on the motor's side: it says where the motor stands, to the drive's loop and to the log."""

    def encoder(self, x: Moment, p: Values) -> tuple[np.ndarray, np.ndarray]:
        if "motor" not in x.memory:  # as `loosened` lays the spring and the play at first
            return self.bent(x.torque, p), 0.0 * x.v
        return (
            x.memory["motor"] - x.memory["rigid"],
            x.memory["motor speed"] - x.memory["rigid speed"],
        )


class Backlash(_Transmission):
    """Play between motor and joint: no torque passes within +-gap / 2."""

    id, title = "backlash", "play between motor and joint"
    parameters = (EffectParameter("gap", "rad", "the whole play", 0.3 * DEGREE, 1 * DEGREE, 3 * DEGREE, 0.3),)
    near = ("command_deadband", "joint_elasticity")
    separate_by = "small fast reversals, with the load on one side and then without"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque + loosened(torque, x, gap=p["gap"], compliance=0.0)


class MotorBacklash(Backlash, _OnMotor):
    """As `backlash`, with the encoder on the motor's side: the log misses what the joint does within the play."""

    id, title = "motor_backlash", "play between motor and joint, the encoder on the motor"
    near = ("backlash", "motor_elasticity", "command_deadband")
    separate_by = "a second encoder on the output, or small fast reversals filmed from outside"

    def bent(self, torque: np.ndarray, p: Values) -> np.ndarray:
        """(rows, joints) how far ahead of the joint the motor stands at rest under a torque."""
        return 0.5 * p["gap"] * np.sign(torque)

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque + loosened(torque, x, gap=p["gap"], compliance=0.0, followed=True)


class JointElasticity(_Transmission):
    """A spring between motor and joint."""

    id, title = "joint_elasticity", "a spring between motor and joint"
    parameters = (
        EffectParameter(
            "compliance", "rad/(N*m)", "angle per torque", 0.0125, 0.0375, 0.1125, 0.5, per="stiffness"
        ),
    )
    near = ("command_lag", "backlash")
    separate_by = "a chirp beyond 5 Hz, and static loads on the locked motor"

    def why_not(self, robot: Robot) -> str | None:
        return (
            None if drives(robot, "position", "duty_servo") else "no servo whose stiffness could be compared"
        )

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        return tuple(at for at in super().places(robot) if not at or {*at} <= _servos(robot))

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque + loosened(torque, x, gap=None, compliance=p["compliance"])


def _servos(robot: Robot) -> set[str]:
    """Joints whose drive moves to a position."""
    moved = takes_positions(nominal_ports(robot, 1))
    return {joint for joint, own in zip(robot.joints, moved, strict=True) if own}


class CableCoupling(Effect):
    """A motor that turns with two joints, one after the other: its friction acts on the sum of both speeds.

    So it is where the cables or the gear of a joint run through the one before (the wrist of a Staubli TX40, joints 5
    and 6). With speed = v + s v', s the sign of `torque` (below 0 the motor turns with the difference):
    |torque| tanh(speed / COUPLED_SPEED) + coefficient speed is taken off the first joint, and s times as much off the
    second. The motor's inertia is left out: in that wrist it is a hundredth of the links'.
    """

    id, acts_on, title = "cable_coupling", "transmission", "a motor turns with two joints, by cables or gears"
    parameters = (
        EffectParameter(
            "torque",
            "N*m",
            "dry friction on the sum of speeds",
            0.01,
            0.03,
            0.08,
            0.5,
            per="torque",
            signed=True,
        ),
        EffectParameter(
            "coefficient",
            "N*m*s/rad",
            "torque per sum of speeds",
            0.05 / 6,
            0.15 / 6,
            0.40 / 6,
            1.0,
            per="torque",
        ),
    )
    near = ("coulomb_friction", "viscous_friction", "load_friction")
    separate_by = "move each of the two joints alone, then both together and both against each other"

    def why_not(self, robot: Robot) -> str | None:
        without = super().why_not(robot)
        if without or not robot.model.njnt or not neighbours(robot):
            return without or "no joint that is driven hangs on another"
        return "an engine of the robot moves each joint alone" if "joint" in robot.engines else None

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        return neighbours(robot)

    def misplaced(self, robot: Robot, at: tuple[str, ...]) -> tuple[str, str] | None:
        pairs = neighbours(robot)
        expected = f"two neighbours, one of {quoted(','.join(pair) for pair in pairs)}"
        return None if at in pairs else (f"{','.join(at) or 'all joints'!r}", expected)

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        way = np.where(p["torque"] < 0.0, -1.0, 1.0)
        first, second = x.v[:, :1], x.v[:, 1:]
        # of what both joints together set against a torque on their sum; wider where a time step would overshoot
        inertia = 1.0 / (1.0 / x.inertia[:, :1] + 1.0 / x.inertia[:, 1:])
        dry = np.abs(p["torque"])
        within = np.maximum(COUPLED_SPEED, dry * x.h / inertia)
        speed = first + way * second
        taken = dry * np.tanh(speed / within) + p["coefficient"] * speed / (
            1.0 + x.h * p["coefficient"] / inertia
        )
        return torque - np.concatenate([taken, way * taken], axis=1)


class MotorElasticity(JointElasticity, _OnMotor):
    """As `joint_elasticity`, with the encoder on the motor's side: the log misses what the spring gives."""

    id, title = "motor_elasticity", "a spring between motor and joint, the encoder on the motor"
    near = ("joint_elasticity", "motor_backlash", "torque_lag")
    separate_by = "a second encoder on the output, or static loads with the motor held"

    def bent(self, torque: np.ndarray, p: Values) -> np.ndarray:
        """(rows, joints) how far ahead of the joint the motor stands at rest under a torque."""
        return p["compliance"] * torque

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque + loosened(torque, x, gap=None, compliance=p["compliance"], followed=True)


def loosened(
    torque: np.ndarray, x: Moment, *, gap: np.ndarray | None, compliance: Any, followed: bool = False
) -> np.ndarray:
    """Torque that a transmission passes from a motor driven by `torque`, minus what a rigid one passes.

    followed : whether the drive's loop follows the motor, not the joint.
    """
    if "motor" not in x.memory:
        rigid = x.h**2 / (RIGID * x.inertia)  # compliance [rad/(N m)]; it cancels to first order
        for motor, play, stiffness in (
            ("motor", 0.0 if gap is None else gap, 1.0 / (rigid + compliance)),
            ("rigid", 0.0, 1.0 / rigid),
        ):
            # at first the spring is at rest under the torque of the drive
            x.memory[motor] = x.q + torque / stiffness + 0.5 * play * np.sign(torque)
            x.memory[f"{motor} speed"] = x.v
            x.memory[f"{motor} step"] = _motor_step(x, stiffness, followed)
    half = None if gap is None else 0.5 * gap
    given = {motor: torque for motor in ("motor", "rigid")}
    if followed:  # its back-EMF brakes the motor itself: within the play, too
        given = {motor: torque - x.damping * (x.memory[f"{motor} speed"] - x.v) for motor in given}
    return _passed(given["motor"], x, "motor", half) - _passed(given["rigid"], x, "rigid", None)


def _motor_step(x: Moment, stiffness: np.ndarray, followed: bool) -> np.ndarray:
    """(6, ...) factors of the motor's speed, torque, the joint's speed and the bent spring; its inertia / h; h.

    Implicit Euler (the motor side is stiff and light), the joint explicit:
    rotor (w' - w) / h = torque - k (bent + h (w' - v)) - c (w' - v).
    """
    rotor = np.maximum(x.memory["rotor"], LIGHT * x.inertia)
    if followed:  # a light motor in a stiff loop: implicit in the loop's law, which is as much more inertia
        rotor = rotor + x.h * (x.rate + x.h * x.stiffness)
    damping = 1.4 * np.sqrt(stiffness * rotor)
    whole = rotor + x.h * (damping + x.h * stiffness)
    moved = (x.h * damping + x.h**2 * stiffness) / whole
    factors = (rotor / whole, x.h / whole, moved, x.h * stiffness / whole, rotor / x.h, x.h)
    return np.stack(np.broadcast_arrays(*factors))


def _passed(torque: np.ndarray, x: Moment, motor: str, half: np.ndarray | None) -> np.ndarray:
    """Torque that reaches the joint; the motor's angle and speed are kept in the memory.

    half : of the play [rad]; None where there is none.
    """
    angle, speed = x.memory[motor], x.memory[f"{motor} speed"]
    of_speed, of_torque, of_joint, of_spring, rate, h = x.memory[f"{motor} step"]
    bent = angle - x.q
    freely = of_speed * speed + of_torque * torque + of_joint * x.v
    if half is None:
        after = freely - of_spring * bent
    else:  # flanks push, they do not pull
        above, below = freely - of_spring * (bent - half), freely - of_spring * (bent + half)
        alone = speed + torque / rate
        after = np.where(above <= alone, above, np.where(below >= alone, below, alone))
    x.memory[motor], x.memory[f"{motor} speed"] = angle + h * after, after
    return torque - rate * (after - speed)  # what does not speed the motor up
