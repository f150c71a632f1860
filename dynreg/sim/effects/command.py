"""Effects on commands: what reaches the drive is not what was sent."""

import numpy as np

from dynreg.sim.effects.effect import DEGREE, Effect, EffectParameter, Moment, OfAnyDrive, Values, drives
from dynreg.sim.robot import Robot


class _OnTargets(Effect):
    """Needs drives that are told what to reach."""

    def why_not(self, robot: Robot) -> str | None:
        able = drives(robot, "position", "duty_servo", "velocity")
        return None if able else "no drive takes positions or speeds"


class CommandDelay(OfAnyDrive):
    """u(t) -> u(t - delay)."""

    id, acts_on, title = "command_delay", "command", "commands arrive late"
    parameters = (EffectParameter("delay", "s", "from sending to acting", 0.005, 0.010, 0.020, 0.4),)
    group = "time shift"
    near = ("command_lag", "sensor_delay")
    separate_by = "a hardware loop-back: log when the drive itself sees the command"
    recalls = True

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return x.past(p["delay"])


class CommandGain(OfAnyDrive):
    """u -> (1 + gain) u."""

    id, acts_on, title = "command_gain", "command", "commands are scaled on their way"
    parameters = (
        EffectParameter("gain", "1", "relative error of the command", 0.02, 0.06, 0.15, 0.6, signed=True),
    )
    near = ("encoder_scale",)
    separate_by = "hold three distant targets without load and measure the angles by hand"
    recalls = True

    def alone(self, robot: Robot) -> bool:
        return robot.file.base is None  # one wheel's is `wheel_gain` and half of both wheels'

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return u * (1.0 + p["gain"])


class RateLimit(_OnTargets):
    """The command that acts follows the one sent at most at `rate`."""

    id, acts_on, title = "rate_limit", "command", "commands change at a limited rate"
    parameters = (
        EffectParameter("rate", "rad/s", "fastest change", 10.0, 5.0, 2.5, 0.3, per="command", inverse=True),
    )
    near = ("speed_limit", "command_lag")
    separate_by = "steps of different height without load: a rate limit takes time in proportion to height"
    recalls = True

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        last = x.memory.get("u")
        last = x.q.copy() if last is None else last
        reach, gap = p["rate"] * x.h, u - last
        moved = np.clip(gap, -reach, reach)
        x.memory["u"] = last + moved
        # the mean over the time step; positions that are reached within it count as reached at once, for a servo's own
        # loop is quicker, while a speed that is asked for at once would be off in all that it drives
        late = 0.5 * np.clip(np.abs(gap) / reach - (0.0 if x.speeds else 1.0), 0.0, 1.0)
        return last + moved * (1.0 - late)


class ProfileSpeed(Effect):
    """The servo's own profile generator: its target moves to the command with bounded speed and acceleration.

    A trapezoid of speed, with the acceleration speed^2 / (2 reach): it brakes in time to stop on the command. Where it
    is at its speed at once it is `rate_limit`.
    """

    id, acts_on = "profile_speed", "command"
    title = "the servo moves its target along a profile of bounded speed and acceleration"
    parameters = (
        EffectParameter("speed", "rad/s", "fastest change of the target", 10.0, 5.0, 2.5, 0.3, inverse=True),
        EffectParameter("reach", "rad", "from rest to that speed", 0.12, 0.12, 0.12, 2.0, shape=True),
    )
    near = ("rate_limit", "command_lag", "speed_limit")
    separate_by = (
        "read the servo's profile registers, or log the target that its loop follows in one high step"
    )
    recalls = True

    def why_not(self, robot: Robot) -> str | None:
        return None if drives(robot, "position", "duty_servo") else "no drive follows positions"

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        last, speed = x.memory.get("target"), x.memory.get("speed")
        if last is None:  # a log that begins in motion begins within a profile
            last, speed = x.q.copy(), np.clip(x.v, -p["speed"], p["speed"])
        gap, gain = u - last, 0.5 * p["speed"] * p["speed"] / p["reach"] * x.h
        far = np.abs(gap) / x.h
        # so many steps of braking, each by `gain`, end on the command; what is nearer is reached at once
        brakes = np.sqrt(0.25 + 2.0 * far / gain) - 0.5
        wanted = np.sign(gap) * np.minimum(np.minimum(p["speed"], gain * brakes), far)
        speed = speed + np.clip(wanted - speed, -gain, gain)
        x.memory["target"], x.memory["speed"] = last + x.h * speed, speed
        # the mean over the time step, as in `rate_limit`
        late = 0.5 * np.clip(far / np.maximum(np.abs(speed), 1e-12) - 1.0, 0.0, 1.0)
        return last + x.h * speed * (1.0 - late)


class CommandLag(OfAnyDrive):
    """First-order low pass: rate of y = (u - y) / time."""

    id, acts_on, title = "command_lag", "command", "commands are smoothed by a first-order lag"
    parameters = (EffectParameter("time", "s", "time constant", 0.005, 0.012, 0.030, 0.5),)
    near = ("command_delay", "joint_elasticity")
    separate_by = "a chirp: a lag damps fast commands, a delay does not"
    recalls = True  # a log that begins in motion begins within its transients

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        last = x.memory.get("u")
        last = u.copy() if last is None else last
        steps = x.h / np.maximum(p["time"], 1e-6)
        keep = np.exp(-steps)
        x.memory["u"] = u + keep * (last - u)
        return u + (1.0 - keep) / steps * (last - u)  # the mean over the time step


class CommandDeadband(_OnTargets):
    """The servo ignores errors of its position within +-width; a drive gives `width` less speed than it is told."""

    id, acts_on = "command_deadband", "command"
    title = "the servo ignores small position errors, the wheel small speeds"
    parameters = (
        EffectParameter(
            "width", "rad", "half of the band", 0.3 * DEGREE, 1 * DEGREE, 2.5 * DEGREE, 0.3, per="command"
        ),
    )
    near = ("coulomb_friction", "backlash")
    separate_by = "a slow triangle under load in both directions, and holds with the load reversed"

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        rest = 0.0 if x.speeds else x.q
        return u - np.clip(u - rest, -p["width"], p["width"])
