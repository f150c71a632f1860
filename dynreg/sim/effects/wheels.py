"""Effects of wheels: a base on the ground does not go where its wheels were told to take it."""

import numpy as np

from dynreg.data.names import quantity_of
from dynreg.sim.effects.effect import Effect, EffectParameter, Moment, Site, Values, drives
from dynreg.sim.robot import Robot


class _OfTwoWheels(Effect):
    """Needs a base on a left and a right wheel."""

    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        if not robot.planar:
            return "no engine moves the robot on wheels"
        return None if robot.file.base else "no left and right wheel ([base] of robot.toml)"


class WheelGain(_OfTwoWheels):
    """The right wheel turns faster than told by half of `difference`, the left one slower by as much."""

    id, acts_on, title = "wheel_gain", "drive", "one wheel turns faster than the other at the same command"
    parameters = (
        EffectParameter("difference", "1", "right - left, relative", 0.02, 0.06, 0.15, 0.6, signed=True),
    )
    near = ("command_gain", "encoder_scale")
    separate_by = (
        "drive the same square both ways round: the errors of a gain change sides, those of a zero do not"
    )

    def configure(self, site: Site, p: Values) -> None:
        owners = np.array(site.robot.joints)[site.joints]
        side = np.where(owners == site.robot.file.base.right, 0.5, -0.5)
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


class TurnSlowdown(Effect):
    """Speed, to either side and never through zero, is less by `arm` times the yaw rate that is told.

    So drives a base whose speed command is meant for a point `arm` outside the middle of its axle, on the outer side of
    every turn (a controller that bounds or tells the outer wheel), and one whose castor drags in turns.
    """

    id, acts_on, title = "turn_slowdown", "command", "the base drives slower while it turns"
    parameters = (
        EffectParameter("arm", "m", "speed lost for each rad/s of the yaw rate", 0.005, 0.015, 0.04, 0.5),
    )
    near = ("command_gain", "wheel_slip")
    separate_by = "drive circles of different radius at one speed command: straight on nothing is lost"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        if not robot.planar:
            return "no engine moves the robot on wheels"
        return None if len(robot.actions) == 2 else "it is not told both speed and yaw rate"

    def configure(self, site: Site, p: Values) -> None:
        # (rows, 2) shares of both commands in speed and in yaw rate, and what takes the loss
        base = site.robot.file.base
        if base:
            side = np.array([1.0 if joint == base.right else -1.0 for joint in site.robot.joints])
            turn = side / site.ports.base["track"][site.rows, None]
            speed, gives = np.full_like(turn, 0.5), np.ones_like(turn)
        else:
            gives = np.array([quantity_of(n) == "speed_command" for n in site.robot.actions], dtype=float)
            gives = np.tile(gives, (len(p["arm"]), 1))
            speed, turn = gives, 1.0 - gives
        site.memory.update(speed=speed, turn=turn, gives=gives)

    def command(self, u: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        speed, turn = ((u * x.memory[k]).sum(axis=1, keepdims=True) for k in ("speed", "turn"))
        lost = np.minimum(p["arm"] * np.abs(turn), np.abs(speed))
        return u - np.sign(speed) * lost * x.memory["gives"]


class WheelSlip(_OfTwoWheels):
    """The ground takes a wheel along at most at `grip`: beyond it the wheel spins, or slides as it brakes."""

    id, acts_on, title = "wheel_slip", "contact", "wheels spin and slide where speeds change quickly"
    parameters = (
        EffectParameter(
            "grip", "m/s^2", "fastest change of speed on the ground", 2.0, 1.0, 0.5, 0.05, inverse=True
        ),
    )
    near = ("rate_limit", "drive_inertia")
    separate_by = "hold the encoders against an outside view of the base: slip is what they do not see"

    def roll(self, speed: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        ground = x.memory.get("ground")
        ground = x.v.copy() if ground is None else ground
        gap, reach = x.q - ground, p["grip"] * x.h
        after = np.where(np.abs(gap) <= reach, x.q, ground + np.clip(gap, -reach, reach))
        x.memory["ground"] = after
        share = np.minimum(np.abs(gap) / reach, 1.0)  # of the time step until the wheel holds again
        slipping = share * 0.5 * (ground + after) + (1.0 - share) * after
        return np.where((ground == x.v) & (after == x.q), speed, slipping)
