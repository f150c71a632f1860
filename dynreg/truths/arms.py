"""Truths whose joints carry weight: what every one of them has in common, from parameters and a cause to readings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dynreg.rng import stream
from dynreg.truths.causes import Units
from dynreg.truths.chain import Chain
from dynreg.truths.joints import STEP, read_speed, reading
from dynreg.truths.kernels import joints
from dynreg.truths.rows import OFFSET, ROWS, SCALE, plain
from dynreg.truths.truth import Commands, Sensor, Truth

DISTURBED = 0.005  # of a joint's torque limit, 1 sigma, drawn anew for every command: by contract
COLOUR = 0.3  # s of a coloured disturbance
ALL = slice(None)  # joints
STAND = 4.0  # times the robot's unit of inertia has a stand that gives
STAND_RING = 0.1  # its damping ratio: a table's
MOTOR_SIDE = ("motor_backlash", "motor_elasticity")  # where the encoder sits
EMF_OUTSIDE = ("backlash", "joint_elasticity")  # what the library's transmissions do with a motor's back-EMF
# causes that are one row of the joints each: {cause: {value: row}}
_ROWS: Mapping[str, Mapping[str, str]] = {
    "viscous_friction": {"coefficient": "viscous"},
    "asymmetric_viscous": {"difference": "lopsided"},
    "coulomb_friction": {"torque": "coulomb"},
    "stribeck_friction": {"coulomb": "coulomb", "extra": "extra", "velocity": "fades"},
    "lugre_friction": {"coulomb": "coulomb", "extra": "extra", "velocity": "fades", "bend": "bend"},
    "dahl_friction": {"torque": "coulomb", "bend": "bend"},
    "load_friction": {"coefficient": "load"},
    "stribeck_load_friction": {
        "coefficient": "load",
        "extra": "load_extra",
        "growth": "load_growth",
        "velocity": "fades",
    },
    "asymmetric_friction": {"mean": "coulomb", "difference": "asymmetric"},
    "friction_drift": {"rate": "drift"},
    "friction_patch": {"torque": "patch", "angle": "patch_at", "width": "patch_wide"},
    "quadratic_drag": {"coefficient": "drag"},
    "speed_limit": {"no_load_speed": "no_load_speed"},
    "voltage_sag": {"sag": "sag"},
    "thermal_fade": {"fade": "fade"},
    "heat_build_up": {"fade": "build_up"},
    "cogging": {"sine": "ripple_sine", "cosine": "ripple_cosine", "count": "ripple_count"},
    "cogging_7": {"ripple": "ripple_sine"},
    "cogging_24": {"ripple": "ripple_sine"},
    "force_offset": {"torque": "force"},
    "backlash": {"gap": "gap"},
    "motor_backlash": {"gap": "gap"},
    "braked_backlash": {"gap": "gap"},
    "joint_elasticity": {"compliance": "compliance"},
    "motor_elasticity": {"compliance": "compliance"},
    "braked_elasticity": {"compliance": "compliance"},
    "inertia": {"armature": "armature"},
    "encoder_offset": {"offset": "offset"},
    "encoder_eccentricity": {"sine": "eccentric", "cosine": "eccentric_cosine"},
    "command_delay": {"delay": "command_delay"},
    "command_gain": {"gain": "command_gain"},
    "command_lag": {"time": "command_lag"},
    "command_deadband": {"width": "deadband"},
    "rate_limit": {"rate": "rate_limit"},
    "profile_speed": {"speed": "profile_speed", "acceleration": "profile_acceleration"},
    "feedback_delay": {"delay": "feedback_delay"},
    "torque_lag": {"time": "torque_lag"},
}
# not added to what a row has
_SET = ("fades", "bend", "no_load_speed", "rate_limit", "profile_speed", "profile_acceleration", "patch_wide")
_COUNTS = {"cogging_7": 7.0, "cogging_24": 24.0}  # a turn
# causes of the whole robot, which `Arm` and `_episode_of` read
_WHOLE = (
    "torque_limit",
    "drive_gain",
    "encoder_scale",
    "payload",
    "com_offset",
    "gravity_tilt",
    "soft_stand",
    "cable_coupling",
    "sensor_delay",
    "clock_error",
    "coloured_disturbance",
)
CAUSES_OF_ARMS = (*_ROWS, *_WHOLE)


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot whose joints carry weight.

    joints : names, from the base outwards. home : (n,) angles [rad] where nothing tells others. chain, drives : what
    parameters and an episode's settings make of links and of `joints.ROWS`. tilts : (3,) the axis about which its base
    can lean. carrier : number of the link whose centre of mass may be off, and (3,) the direction. tool : number of the
    link that carries a payload, and (3,) [m] where. supply : nominal [V], where the drives hear one.
    """

    joints: tuple[str, ...]
    home: np.ndarray
    chain: Callable[[Mapping[str, float], Mapping[str, float]], Chain]
    drives: Callable[[Mapping[str, float], Mapping[str, float]], np.ndarray]
    tilts: np.ndarray
    carrier: tuple[int, np.ndarray]
    tool: tuple[int, np.ndarray]
    units: Units
    sensors: tuple[Sensor, ...]
    supply: float | None = None

    def states(self, truth: Truth, commands: Commands) -> np.ndarray:
        """(E, T+1, 2 n) readings of angles and speeds without noise, in the order of the joints."""
        pushes = self._pushes(truth, commands)
        heat = np.zeros((2, len(self.joints)))
        out = []
        for e in range(len(commands.actions)):
            if truth.cause != "heat_build_up":
                heat[:] = 0.0  # the library's motors begin each episode cold
            out.append(self._episode(truth, commands, e, pushes[e], heat))
        return np.stack(out)

    def _episode(
        self, truth: Truth, commands: Commands, e: int, push: np.ndarray, heat: np.ndarray
    ) -> np.ndarray:
        """(T+1, 2 n) readings of one episode; heat (2, n) goes on."""
        values, cause, n = truth.values, truth.cause, len(self.joints)
        settings = {name: float(of[e]) for name, of in commands.settings.items()}
        chain, x = self._links(truth, settings), self.rows(truth, settings)
        stand = np.zeros(2)
        if cause == "soft_stand":
            inertia = STAND * self.units.inertia
            stiffness = 1.0 / values["compliance"]
            chain = chain.on_stand(self.tilts, inertia)
            stand = np.array([stiffness, 2.0 * STAND_RING * np.sqrt(stiffness * inertia)])
        period = commands.period / (1.0 + (values["error"] if cause == "clock_error" else 0.0))
        q, v = self._start(commands, e, x)
        steps = commands.actions.shape[1]
        count = round(period / STEP)
        told = np.empty((steps * count + 1, 2, n))
        usual = 1.0 if self.supply is None else self.supply
        power = commands.input("supply", usual)[e] / usual
        enabled = commands.input(f"{self.joints[0]}/enabled", 1.0)[e]
        coupling = values["stiffness"] if cause == "cable_coupling" else 0.0
        actions = np.ascontiguousarray(commands.actions[e], dtype=float)
        joints().episode(
            chain.parts, x, stand, coupling, actions, power, enabled, push,
            period, count, float(commands.begin[e]), q, v, heat, told,
        )  # fmt: skip
        late = values["delay"] if cause == "sensor_delay" else 0.0
        at = np.maximum(np.arange(steps + 1) * count - round(late / period * count), 0)
        angle, speed = told[at, 0], told[at, 1]
        return np.concatenate([reading(x, ALL, angle), read_speed(x, ALL, angle, speed)], axis=1)

    def _start(self, commands: Commands, e: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,), (n,) angles and speeds that the readings of the start tell."""
        n = len(self.joints)
        home = np.concatenate([x[SCALE] * (self.home + x[OFFSET]), np.zeros(n)])
        first = home if commands.initial is None else commands.initial[e]
        first = np.where(np.isnan(first), home, first)
        angle = self.home
        for _ in range(20):  # a disc that runs out of true by a few degrees: each turn gains a digit
            angle = angle - (reading(x, ALL, angle) - first[:n]) / x[SCALE]
        return angle, first[n:] / read_speed(x, ALL, angle, 1.0)

    def _links(self, truth: Truth, settings: Mapping[str, float]) -> Chain:
        """The links with the cause in them."""
        chain, values = self.chain(truth.parameters, settings), truth.values
        if truth.cause == "payload":
            return chain.carrying(self.tool[0], values["mass"], self.tool[1])
        if truth.cause == "gravity_tilt":
            return chain.tilted(self.tilts, values["angle"])
        if truth.cause == "com_offset":
            return chain.shifted(self.carrier[0], values["shift"] * self.carrier[1])
        return chain

    def rows(self, truth: Truth, settings: Mapping[str, float]) -> np.ndarray:
        """(rows, n) of the joints with the cause in them."""
        x = np.ascontiguousarray(self.drives(truth.parameters, settings))
        at = [self.joints.index(j) for j in truth.joints] or list(range(len(self.joints)))
        row = {name: i for i, name in enumerate(ROWS)}
        values, cause = truth.values, truth.cause
        for name, target in _ROWS.get(cause or "", {}).items():
            x[row[target], at] = values[name] + (0.0 if target in _SET else x[row[target], at])
        if cause in _COUNTS:
            x[row["ripple_count"], at] = _COUNTS[cause]
        x[row["motor_side"], at] = cause in MOTOR_SIDE
        x[row["emf_outside"], at] = cause in EMF_OUTSIDE
        if cause == "torque_limit":
            x[row["limit"], at] *= 1.0 - values["loss"]
        if cause == "drive_gain":
            for name in ("gain", "rate_gain"):
                x[row[name], at] *= 1.0 + values["gain"]
        if cause == "encoder_scale":
            x[row["scale"], at] *= 1.0 + values["error"]
        return x

    def _pushes(self, truth: Truth, commands: Commands) -> np.ndarray:
        """(E, T, n) [N m] that push the joints: white noise, and coloured where that is the cause."""
        shape = commands.actions.shape
        rng = stream(truth.seed, "truth pushes")
        limit = self.drives(truth.parameters, {})[ROWS.index("limit")]
        white = 0.0 if truth.exact else DISTURBED * limit
        push = white * rng.standard_normal(shape)
        if truth.cause == "coloured_disturbance":
            at = [self.joints.index(j) for j in truth.joints] or list(range(len(self.joints)))
            push[..., at] += truth.values["torque"] * coloured(rng, shape, commands.period)[..., at]
        return push


def coloured(rng: np.random.Generator, shape: tuple[int, int, int], period: float) -> np.ndarray:
    """(E, T, n) noise of unit variance that forgets itself in `COLOUR`."""
    keep = np.exp(-period / COLOUR)
    out = rng.standard_normal(shape)
    for t in range(1, shape[1]):
        out[:, t] = keep * out[:, t - 1] + np.sqrt(1.0 - keep**2) * out[:, t]
    return out


def of_positions(
    gain: np.ndarray,
    rate_gain: np.ndarray,
    limit: np.ndarray,
    armature: np.ndarray,
    viscous: np.ndarray,
    coulomb: np.ndarray,
) -> np.ndarray:
    """(rows, n) of joints with position drives: torque = gain (u - q) - rate_gain v, at most limit."""
    x = plain(len(gain))
    named = {
        "gain": gain,
        "rate_gain": rate_gain,
        "limit": limit,
        "armature": armature,
        "viscous": viscous,
        "coulomb": coulomb,
    }
    for name, row in named.items():
        x[ROWS.index(name)] = row
    return x


def joint_sensors(joints: tuple[str, ...], angle: tuple[float, float], speed: tuple[float, float]) -> tuple:
    """Sensors of angles, then of speeds: (noise, quantum) of each."""
    return tuple(
        Sensor(f"{joint}/{name}", *what)
        for name, what in (("position", angle), ("velocity", speed))
        for joint in joints
    )
