"""Effects of friction: torque that opposes motion. Bounds are those of dry friction; engines stop what is slow."""

import numpy as np

from dynreg.sim.effects.effect import Effect, EffectParameter, Moment, Site, Values

NO_SPEED = 6.0  # rad/s at which viscous and quadratic friction are sized
STILL = 1e-4  # rad/s below which a joint counts as at rest


class CoulombFriction(Effect):
    """Constant dry friction."""

    id, acts_on, title = "coulomb_friction", "friction", "dry friction, the same at all speeds"
    parameters = (EffectParameter("torque", "N*m", "dry friction", 0.01, 0.03, 0.08, 0.5, per="torque"),)
    near = ("stribeck_friction", "asymmetric_friction", "load_friction")
    separate_by = "slow reversals at two loads"

    def configure(self, site: Site, p: Values) -> None:
        site.friction("coulomb", lambda c: c + p["torque"])


class ViscousFriction(Effect):
    """Friction in proportion to speed."""

    id, acts_on, title = "viscous_friction", "friction", "friction in proportion to speed"
    parameters = (
        EffectParameter(
            "coefficient",
            "N*m*s/rad",
            "torque per speed",
            0.05 / NO_SPEED,
            0.15 / NO_SPEED,
            0.40 / NO_SPEED,
            1.0 / NO_SPEED,
            per="torque",
        ),
    )
    near = ("quadratic_drag", "speed_limit")
    separate_by = "a torque-off drop, and steps that saturate the drive"

    def configure(self, site: Site, p: Values) -> None:
        site.friction("viscous", lambda c: c + p["coefficient"])


class StribeckFriction(Effect):
    """Dry friction that is larger near standstill: coulomb + extra exp(-(v / velocity)^2)."""

    id, acts_on, title = "stribeck_friction", "friction", "dry friction, larger near standstill"
    parameters = (
        EffectParameter("extra", "N*m", "more at standstill", 0.02, 0.05, 0.10, 0.6, per="torque"),
        EffectParameter("coulomb", "N*m", "dry friction", 0.01, 0.025, 0.05, 0.5, per="torque", shared=True),
        EffectParameter("velocity", "rad/s", "where it fades", 0.3, 0.3, 0.3, 2.0, shape=True),
    )
    near = ("coulomb_friction", "stribeck_load_friction")
    separate_by = "slow reversals"

    def friction(self, x: Moment, p: Values) -> np.ndarray:
        return p["coulomb"] + p["extra"] * np.exp(-((x.v / p["velocity"]) ** 2))


class LoadFriction(Effect):
    """Dry friction in proportion to the torque that the gear transmits."""

    id, acts_on, title = "load_friction", "friction", "dry friction that grows with the load on the gear"
    parameters = (
        EffectParameter("coefficient", "1", "friction per transmitted torque", 0.03, 0.08, 0.2, 1.0),
    )
    near = ("coulomb_friction", "stribeck_load_friction")
    separate_by = "slow reversals at two loads"

    def friction(self, x: Moment, p: Values) -> np.ndarray:
        return p["coefficient"] * transmitted(x)


class StribeckLoadFriction(Effect):
    """Load friction that is larger near standstill, and whose share grows with the load:
    (coefficient + extra exp(-|v| / velocity) + growth |load| / limit) |load|, limit the drive's torque limit.

    The exponential fades sharply at first and has a long tail, as gears do; a bell curve has to choose one of the
    two, and a fit of it ends in one local optimum or the other. The growth is that of quadratic load friction
    (M6 of Duclusaud et al., arXiv 2410.08650).
    """

    id, acts_on = "stribeck_load_friction", "friction"
    title = "load friction, larger near standstill"
    parameters = (
        EffectParameter("extra", "1", "more at standstill", 0.05, 0.10, 0.20, 1.0),
        EffectParameter(
            "coefficient", "1", "friction per transmitted torque", 0.02, 0.05, 0.10, 1.0, shared=True
        ),
        EffectParameter("growth", "1", "more at full torque", 0.05, 0.10, 0.20, 1.0),
        EffectParameter("velocity", "rad/s", "where it fades", 0.3, 0.3, 0.3, 2.0, shape=True),
    )
    near = ("load_friction", "stribeck_friction")
    separate_by = "slow reversals at two loads"

    def friction(self, x: Moment, p: Values) -> np.ndarray:
        load = transmitted(x)
        share = p["coefficient"] + p["extra"] * np.exp(-np.abs(x.v) / p["velocity"])
        return (share + p["growth"] * np.minimum(load / x.limit, 1.0)) * load


class AsymmetricFriction(Effect):
    """Dry friction that differs between the two directions.

    The same as a constant torque of minus half the difference beside symmetric dry friction, moving or at rest: no
    motion tells the two apart.
    """

    id, acts_on, title = "asymmetric_friction", "friction", "dry friction that differs between directions"
    parameters = (
        EffectParameter(
            "difference", "N*m", "half the difference", 0.007, 0.018, 0.035, 0.4, per="torque", signed=True
        ),
        EffectParameter("mean", "N*m", "mean of both", 0.0105, 0.027, 0.0525, 0.4, per="torque", shared=True),
    )
    group = "constant torque"
    near = ("coulomb_friction",)
    separate_by = "the joint turned around: friction turns with it, a constant torque does not"

    def friction(self, x: Moment, p: Values) -> np.ndarray:
        # a joint at rest is held against the way that it is pushed
        towards = np.where(np.abs(x.v) > STILL, x.v, x.torque - x.load)
        return np.maximum(p["mean"] + p["difference"] * np.sign(towards), 0.0)


class AsymmetricViscous(Effect):
    """Viscous friction that differs between the two directions: a torque of -difference |v|, whatever the sign of v."""

    id, acts_on = "asymmetric_viscous", "friction"
    title = "viscous friction that differs between directions"
    parameters = (
        EffectParameter(
            "difference",
            "N*m*s/rad",
            "half the difference",
            0.02 / NO_SPEED,
            0.06 / NO_SPEED,
            0.15 / NO_SPEED,
            1.0 / NO_SPEED,
            per="torque",
            signed=True,
        ),
    )
    near = ("asymmetric_friction", "force_offset")
    separate_by = "the same constant speeds in both directions, slow and fast"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque - p["difference"] * np.abs(x.v)


class FrictionDrift(Effect):
    """Dry friction that grows with the time of the log."""

    id, acts_on, title = "friction_drift", "friction", "dry friction that grows while the log runs"
    parameters = (
        EffectParameter(
            "rate", "N*m/s", "growth a second", 0.06 / 20, 0.15 / 20, 0.3 / 20, 1.0 / 20, per="torque"
        ),
    )
    near = ("thermal_fade", "coulomb_friction")
    separate_by = "repeat the first run at the end"

    def friction(self, x: Moment, p: Values) -> np.ndarray:
        return np.broadcast_to(p["rate"] * x.time, x.v.shape)


class QuadraticDrag(Effect):
    """A torque against motion in proportion to speed squared."""

    id, acts_on, title = "quadratic_drag", "friction", "drag in proportion to speed squared"
    parameters = (
        EffectParameter(
            "coefficient",
            "N*m*s^2/rad^2",
            "torque per speed squared",
            0.02 / NO_SPEED**2,
            0.06 / NO_SPEED**2,
            0.15 / NO_SPEED**2,
            1.0 / NO_SPEED**2,
            per="torque",
        ),
    )
    near = ("viscous_friction",)
    separate_by = "a chirp that reaches the highest speed, and slow motion"

    def drive(self, torque: np.ndarray, x: Moment, p: Values) -> np.ndarray:
        return torque - p["coefficient"] * x.v * np.abs(x.v)


def transmitted(x: Moment) -> np.ndarray:
    """(rows, joints) torque that the gear carries: the mean of what the drive gives and what the load takes."""
    return 0.5 * np.abs(x.torque + x.load)
