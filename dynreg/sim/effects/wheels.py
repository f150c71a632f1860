"""Effects of wheels: a base on the ground does not go where its wheels were told to take it."""

import numpy as np

from dynreg.sim.effects.effect import Effect, EffectParameter, Moment, Site, Values, drives
from dynreg.sim.robot import Robot


class WheelGain(Effect):
    """The right wheel turns faster than told by half of `difference`, the left one slower by as much."""

    id, acts_on, title = "wheel_gain", "drive", "one wheel turns faster than the other at the same command"
    parameters = (
        EffectParameter("difference", "1", "right - left, relative", 0.02, 0.06, 0.15, 0.6, signed=True),
    )
    near = ("command_gain", "encoder_scale")
    separate_by = (
        "drive the same square both ways round: the errors of a gain change sides, those of a zero do not"
    )
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        return _on_two_wheels(robot)

    def configure(self, site: Site, p: Values) -> None:
        owners = [site.robot.actions[i].split("/")[0] for i in site.joints]
        side = np.where([owner == site.robot.file.base.right for owner in owners], 0.5, -0.5)
        site.drive("gain_factor", lambda f: f * (1.0 + side * p["difference"]))


class DriveInertia(Effect):
    """Speed and yaw rate follow with `time` more of a first-order lag than stated."""

    id, acts_on, title = "drive_inertia", "drive", "the base gathers and loses speed more slowly than stated"
    parameters = (EffectParameter("time", "s", "added to its lags", 0.02, 0.05, 0.12, 1.0),)
    near = ("command_lag", "command_delay", "rate_limit")
    separate_by = (
        "steps of different height: a lag takes the same time for all, a rate limit longer for high ones"
    )
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        return None if drives(robot, "velocity") else "no drive is told a speed"

    def configure(self, site: Site, p: Values) -> None:
        site.drive("lag", lambda lag: lag + p["time"])


class WheelSlip(Effect):
    """The ground takes a wheel along at most at `grip`: beyond it the wheel spins, or slides as it brakes."""

    id, acts_on, title = "wheel_slip", "contact", "wheels spin and slide where speeds change quickly"
    parameters = (
        EffectParameter(
            "grip", "m/s^2", "fastest change of speed on the ground", 2.0, 1.0, 0.5, 0.05, inverse=True
        ),
    )
    near = ("rate_limit", "drive_inertia")
    separate_by = "hold the encoders against an outside view of the base: slip is what they do not see"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        return _on_two_wheels(robot)

    def roll(self, speed: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        ground = x.memory.get("ground")
        ground = x.v.copy() if ground is None else ground
        gap, reach = x.q - ground, p["grip"] * x.h
        after = np.where(np.abs(gap) <= reach, x.q, ground + np.clip(gap, -reach, reach))
        x.memory["ground"] = after
        share = np.minimum(np.abs(gap) / reach, 1.0)  # of the time step until the wheel holds again
        slipping = share * 0.5 * (ground + after) + (1.0 - share) * after
        return np.where((ground == x.v) & (after == x.q), speed, slipping)


def _on_two_wheels(robot: Robot) -> str | None:
    if not robot.planar:
        return "no engine moves the robot on wheels"
    return None if robot.file.base else "no left and right wheel ([base] of robot.toml)"
