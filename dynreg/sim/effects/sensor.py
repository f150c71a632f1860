"""Effects of sensors: the log is not what the robot did."""

import numpy as np

from dynreg.data.names import quantity_of
from dynreg.errors import quoted
from dynreg.sim.effects.effect import DEGREE, Effect, EffectParameter, Moment, OfAnyDrive, Site, Values
from dynreg.sim.effects.on_slides import slides_of
from dynreg.sim.robot import Robot


class EncoderOffset(Effect):
    """Encoders read q + offset, to the servo and to the log."""

    id, acts_on, title = "encoder_offset", "sensor", "the encoder's zero is off"
    parameters = (
        EffectParameter(
            "offset", "rad", "reading - truth", 1 * DEGREE, 3 * DEGREE, 8 * DEGREE, 0.5, signed=True
        ),
    )
    group = "gravity phase"
    near = ("force_offset", "encoder_eccentricity")
    separate_by = "turn the base by 180 degrees, and remove the load"

    def configure(self, site: Site, p: Values) -> None:
        site.sensor("offset", lambda o: o + p["offset"])


class EncoderScale(Effect):
    """Encoders read (1 + error) q, to the servo and to the log."""

    id, acts_on, title = "encoder_scale", "sensor", "the encoder's scale is off"
    parameters = (
        EffectParameter("error", "1", "relative error of angles", 0.01, 0.03, 0.08, 0.4, signed=True),
    )
    near = ("command_gain", "encoder_eccentricity")
    separate_by = "hold three distant targets without load and measure the angles by hand"

    def why_not(self, robot: Robot) -> str | None:
        wheels = () if robot.file.base is None else (robot.file.base.left, robot.file.base.right)
        if any(f"{wheel}/{kind}" in robot.channels for wheel in wheels for kind in ("position", "velocity")):
            return None
        return super().why_not(robot)

    def configure(self, site: Site, p: Values) -> None:
        site.sensor("scale", lambda s: s * (1.0 + p["error"]))


class EncoderEccentricity(Effect):
    """Encoders read q + sine sin q + cosine cos q, to the servo and to the log: the disc or the gear runs out of true.

    Over less than half a turn it looks like a wrong scale and an offset.
    """

    id, acts_on, title = "encoder_eccentricity", "sensor", "the encoder's disc runs out of true"
    parameters = (
        EffectParameter(
            "sine", "rad", "error in sin(q)", 0.2 * DEGREE, 0.7 * DEGREE, 1.8 * DEGREE, 0.3, signed=True
        ),
        EffectParameter(
            "cosine", "rad", "error in cos(q)", 0.2 * DEGREE, 0.7 * DEGREE, 1.8 * DEGREE, 0.3, signed=True
        ),
    )
    near = ("encoder_scale", "encoder_offset")
    separate_by = "slow sweeps of the whole turn, and an angle measured by hand at each quarter"

    def why_not(self, robot: Robot) -> str | None:
        slides = slides_of(robot)
        only = slides and len(slides) == len(robot.driven)
        return f"a disc turns, and {slides[0]!r} slides" if only else super().why_not(robot)

    def places(self, robot: Robot) -> tuple[tuple[str, ...], ...]:
        return tuple(at for at in super().places(robot) if self.misplaced(robot, at) is None)

    def misplaced(self, robot: Robot, at: tuple[str, ...]) -> tuple[str, str] | None:
        slides = [joint for joint in slides_of(robot) if not at or joint in at]
        hinges = sorted({*robot.driven} - {*slides_of(robot)})
        told = (
            (f"a disc turns, and {slides[0]!r} slides", f"joints out of {quoted(hinges)}") if slides else None
        )
        return told or super().misplaced(robot, at)

    def encoder(self, x: Moment, p: Values) -> tuple[np.ndarray, np.ndarray]:
        sine, cosine = np.sin(x.q), np.cos(x.q)
        return p["sine"] * sine + p["cosine"] * cosine, (p["sine"] * cosine - p["cosine"] * sine) * x.v


class SensorDelay(OfAnyDrive):
    """The log holds states of `delay` ago."""

    id, acts_on, title = "sensor_delay", "sensor", "measurements are logged late"
    scope = "robot"
    parameters = (EffectParameter("delay", "s", "from moving to logging", 0.004, 0.008, 0.015, 0.4),)
    group = "time shift"
    near = ("command_delay",)
    separate_by = "a hardware loop-back: log when the drive itself sees the command"

    def observe(self, states: np.ndarray, columns: dict, times: np.ndarray, p: Values) -> np.ndarray:
        period = times[:, 1:2] - times[:, :1]
        rows = np.arange(states.shape[1]) - p["delay"] / period
        low = np.clip(np.floor(rows).astype(int), 0, states.shape[1] - 1)
        high = np.minimum(low + 1, states.shape[1] - 1)
        share = np.clip(rows - low, 0.0, 1.0)[..., None]
        at = np.arange(len(states))[:, None]
        before, after = states[at, low], states[at, high]
        out = (1.0 - share) * before + share * after
        # Between rows joints go on with the speeds they have (a cubic by Hermite). By a straight line the delay of
        # two_joint_arm, whose rows are 10 ms apart, is found 3 % too long.
        moving, speed = columns["moving"], columns["moving at"]
        straight = (after - before)[..., moving]
        begin, end = (period[..., None] * one[..., speed] - straight for one in (before, after))
        out[..., moving] += share * (1.0 - share) * ((1.0 - share) * begin - share * end)
        return out


class ClockError(OfAnyDrive):
    """The log's seconds are (1 + error) of true ones."""

    id, acts_on, title = "clock_error", "sensor", "the log's clock runs fast or slow"
    scope = "robot"
    parameters = (
        EffectParameter("error", "1", "relative error of time", 0.01, 0.03, 0.08, 0.3, signed=True),
    )
    group = "time scale"
    near = ("inertia",)
    separate_by = "an external clock"

    def why_not(self, robot: Robot) -> str | None:
        if robot.planar:  # nothing falls or swings, so that nothing tells how long a second is
            return "other wheels and lags do the same to a base without masses"
        return super().why_not(robot)

    def configure(self, site: Site, p: Values) -> None:
        site.ports.control["clock"][site.rows] *= 1.0 / (1.0 + p["error"][:, 0])


class ImuMisalignment(Effect):
    """The IMU is mounted askew: roll and pitch of the base are read off by constants."""

    id, acts_on, title = "imu_misalignment", "sensor", "the IMU is mounted askew"
    parameters = (
        EffectParameter(
            "pitch", "rad", "reading - truth", 1 * DEGREE, 3 * DEGREE, 8 * DEGREE, 0.5, signed=True
        ),
        EffectParameter(
            "roll", "rad", "reading - truth", 1 * DEGREE, 3 * DEGREE, 8 * DEGREE, 0.5, signed=True
        ),
    )
    near = ("gravity_tilt", "com_offset")
    separate_by = "put the robot on a level table, then turn it by 180 degrees"
    scope = "robot"

    def why_not(self, robot: Robot) -> str | None:
        has = {quantity_of(name) for name in robot.channels}
        return None if {"roll", "pitch"} <= has else "no roll and pitch of a base are measured"

    def observe(self, states: np.ndarray, columns: dict, times: np.ndarray, p: Values) -> np.ndarray:
        out = states.copy()
        for name in ("pitch", "roll"):
            for column in columns.get(name, ()):
                out[..., column] += p[name]
        return out
