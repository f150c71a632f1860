"""Effects on drives: the torque that comes is not the torque that the nameplate promises."""

import numpy as np

from dynreg.sim.effects.effect import Effect, EffectParameter, Moment, Site, Values, drives
from dynreg.sim.ports import nominal_ports
from dynreg.sim.robot import Robot
from dynreg.sim.sets import NO_LIMIT, is_limit


class _OfTorque(Effect):
    """Needs a drive with a torque limit that it can reach."""

    acts_on = "drive"

    def why_not(self, robot: Robot) -> str | None:
        limited = [
            t
            for t in robot.file.drives
            if t.type == "duty_servo" or is_limit(getattr(t, "torque_limit", NO_LIMIT))
        ]
        return None if limited and robot.actions else "no drive states a torque limit"


def _of_duty(robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...] | None:
    """The joints, where the drive of each sets a duty: there the duty is what saturates, and both limits are one."""
    types = dict(zip(robot.joints, nominal_ports(robot, 1).types, strict=True))
    owners = tuple(sorted({*(joints or robot.joints)}))
    return owners if all(types[owner] == "duty_servo" for owner in owners) else None


class TorqueLimit(_OfTorque):
    """The drive saturates at (1 - loss) of its stated torque; a duty servo's at as much of its duty."""

    group = "saturation"
    id, title = "torque_limit", "the drive saturates below its stated torque"
    parameters = (EffectParameter("loss", "1", "share of the stated limit", 0.12, 0.25, 0.40, 0.9),)
    near = ("speed_limit", "voltage_sag")
    separate_by = "fast large steps: a speed limit shows in motion, a torque limit when stalled too"

    def about(self, robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...] | None:
        return _of_duty(robot, joints)

    def configure(self, site: Site, p: Values) -> None:
        site.drive("limit_factor", lambda f: f * (1.0 - p["loss"]))


class DutyLimit(Effect):
    """The duty that a servo sets saturates at (1 - loss) of its stated limit, as a PWM limit in its registers does.

    It is `torque_limit` of a duty servo by the name of its cause: no motion tells them apart.
    """

    id, acts_on, title = "duty_limit", "drive", "the servo's duty saturates below its stated limit"
    parameters = (EffectParameter("loss", "1", "share of the stated limit", 0.12, 0.25, 0.40, 0.9),)
    group = "saturation"
    near = ("speed_limit", "voltage_sag")
    separate_by = "read the servo's PWM limit, or measure the voltage at the stalled motor"

    def why_not(self, robot: Robot) -> str | None:
        able = drives(robot, "duty_servo")
        return None if able else "no drive sets a duty: of others `torque_limit` has that role"

    def about(self, robot: Robot, joints: tuple[str, ...]) -> tuple[str, ...] | None:
        return _of_duty(robot, joints)

    def configure(self, site: Site, p: Values) -> None:
        site.drive("duty_limit", lambda d: d * (1.0 - p["loss"]))


class FeedbackDelay(Effect):
    """The drive's own loop sees the position and speed of `delay` ago; its command is not late."""

    id, acts_on, title = "feedback_delay", "drive", "the drive's loop sees its encoder late"
    parameters = (EffectParameter("delay", "s", "from moving to acting on it", 0.002, 0.005, 0.012, 0.1),)
    near = ("torque_lag", "command_delay", "command_lag")
    separate_by = "a hardware loop-back; pushed by hand at a constant command, a late loop swings longer"

    def why_not(self, robot: Robot) -> str | None:
        able = drives(robot, "position", "duty_servo", "speed")
        return None if able else "no drive has a loop of its own"

    def feedback(self, q: np.ndarray, v: np.ndarray, x: Moment, p: Values) -> tuple[np.ndarray, np.ndarray]:
        return x.ago(p["delay"])


class TorqueLag(Effect):
    """The torque that comes follows the one asked for by a first-order lag, as a current loop's does.

    What a motor's back-EMF takes off is a part of it. A run begins with the torque that is asked for as it begins,
    whatever was asked before: that depends on where the joint was, and not on commands alone.
    """

    id, acts_on, title = "torque_lag", "drive", "the torque follows what is asked by a first-order lag"
    parameters = (EffectParameter("time", "s", "time constant", 0.002, 0.006, 0.015, 0.2),)
    near = ("feedback_delay", "command_lag", "joint_elasticity")
    separate_by = "log the motor's current in small fast steps of the command, the joint held"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        taken = x.damping * x.v
        asked = torque - taken
        last = x.memory.get("torque")
        last = asked if last is None else last
        steps = x.h / np.maximum(p["time"], 1e-9)
        keep = np.exp(-steps)
        x.memory["torque"] = asked + keep * (last - asked)
        return torque + (1.0 - keep) / steps * (last - asked)  # the mean over the time step


class SpeedLimit(_OfTorque):
    """Torque in the direction of motion falls linearly to nothing at the no-load speed."""

    id, title = "speed_limit", "torque falls with speed"
    parameters = (
        EffectParameter("no_load_speed", "rad/s", "speed without torque", 25.0, 12.5, 6.3, 0.5, inverse=True),
    )
    near = ("torque_limit", "rate_limit", "viscous_friction")
    separate_by = "fast large steps with and without load"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        room = x.limit * np.maximum(1.0 - np.abs(x.v) / p["no_load_speed"], 0.0)
        return np.where(torque * x.v > 0, np.clip(torque, -room, room), torque)


class DriveGain(Effect):
    """The drive's gain is (1 + gain) of the stated one."""

    id, acts_on, title = "drive_gain", "drive", "the drive is stronger or weaker than stated"
    parameters = (
        EffectParameter("gain", "1", "relative error of the gain", 0.10, 0.25, 0.40, 0.8, signed=True),
    )
    near = ("voltage_sag", "thermal_fade")
    separate_by = "log the supply voltage; rest and repeat"

    def configure(self, site: Site, p: Values) -> None:
        site.drive("gain_factor", lambda f: f * (1.0 + p["gain"]))


class VoltageSag(_OfTorque):
    """The supply drops in proportion to the current drawn: `sag` of it at full torque."""

    id, title = "voltage_sag", "the supply sags under load"
    parameters = (EffectParameter("sag", "1", "drop at full torque", 0.03, 0.08, 0.20, 0.8),)
    near = ("torque_limit", "thermal_fade", "drive_gain")
    separate_by = "log the supply voltage at the drive"

    def shown_by(self, robot: Robot) -> tuple[str, ...]:
        supplies = (getattr(t, "supply_input", None) for t in robot.file.drives)
        return tuple(dict.fromkeys(name for name in supplies if name))

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        current = np.minimum(np.abs(torque - x.damping * x.v) / x.limit, 1.0)  # of that at full torque
        return torque * (1.0 - p["sag"] * current)


class ThermalFade(_OfTorque):
    """Torque fades as the motor warms: heat follows (torque / limit)^2 with a time constant of `WARMING`.

    The motor is cold as an episode, or a window of a log, begins, whatever it did before.
    """

    WARMING = 4.0  # s

    id, title = "thermal_fade", "the motor weakens as it warms"
    parameters = (EffectParameter("fade", "1", "loss when warmed by full torque", 0.15, 0.40, 0.90, 3.0),)
    near = ("voltage_sag", "drive_gain", "friction_drift")
    separate_by = "rest, then repeat the first run"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        heat = x.memory.get("heat", 0.0)
        x.memory["heat"] = heat + x.h / self.WARMING * (np.minimum((torque / x.limit) ** 2, 1.0) - heat)
        return torque * np.maximum(1.0 - p["fade"] * heat, 0.05)


class Cogging(Effect):
    """Torque ripple over position, `count` cycles a turn, of any phase."""

    id, acts_on, title = "cogging", "drive", "the torque ripples with position"
    parameters = (
        EffectParameter(
            "sine", "N*m", "ripple in sin(count q)", 0.009, 0.026, 0.07, 0.4, per="torque", signed=True
        ),
        EffectParameter(
            "cosine", "N*m", "ripple in cos(count q)", 0.009, 0.026, 0.07, 0.4, per="torque", signed=True
        ),
        # over half a turn, counts that differ by less than 2 look alike: from steps of 1 a fit walks to any between
        EffectParameter("count", "1", "cycles a turn", 12, 12, 12, 72, shape=True, tried=tuple(range(2, 61))),
    )
    near = ("coulomb_friction",)
    separate_by = "a slow sweep of the whole range without load"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        angle = p["count"] * x.q
        return torque + p["sine"] * np.sin(angle) + p["cosine"] * np.cos(angle)


class ForceOffset(Effect):
    """A constant torque, whatever is commanded."""

    id, acts_on, title = "force_offset", "drive", "a constant torque pushes the joint"
    parameters = (
        EffectParameter("torque", "N*m", "constant torque", 0.01, 0.03, 0.08, 0.5, per="torque", signed=True),
    )
    group = "constant torque"
    near = ("gravity_tilt",)
    separate_by = "slow sweeps in both directions over the whole range"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque + p["torque"]
