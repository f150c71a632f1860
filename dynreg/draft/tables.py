"""The tables of a drafted robot.toml: robot, drives, actions, channels, reset, fall, excitation, replay."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco

from dynreg.draft.drives import Drive, is_hinge, name_of, reach_of
from dynreg.draft.entry import Entry
from dynreg.sim.held import scalar_joints

DEFAULTS = {  # 1 sigma of sensors that nothing is known of, by unit
    "rad": 0.001,
    "m": 0.0005,
    "rad/s": 0.02,
    "m/s": 0.01,
}
BASE_CHANNELS = {  # of a free base, and the weight of errors in it
    "roll": ("rad", 1.0),
    "pitch": ("rad", 1.0),
    "yaw": ("rad", 1.0),
    "z": ("m", 1.0),
    "wx": ("rad/s", 0.0),
    "wy": ("rad/s", 0.0),
    "wz": ("rad/s", 0.0),
}
ODOMETRY = {  # besides, where a log holds them
    "x": ("m", 1.0),
    "y": ("m", 1.0),
    "vx": ("m/s", 0.0),
    "vy": ("m/s", 0.0),
    "vz": ("m/s", 0.0),
}
# Names of the keyframes to begin from, the best first.
STANDING = ("stand", "home", "stance", "default", "rest")


@dataclass(frozen=True)
class Sensed:
    """What a log says of one channel: 1 sigma and quantum in its unit, where they were seen.

    still : the channel moves no further than its noise. Its errors say nothing of the robot.
    """

    noise: float
    quantum: float
    said: str
    still: bool = False


@dataclass(frozen=True)
class Tables:
    """A robot.toml in tables. Each list is in the order of the file.

    notes : comments at its top. reasons : comments above its parameters.
    """

    robot: Entry
    drives: tuple[Entry, ...]
    actions: tuple[Entry, ...]
    channels: tuple[Entry, ...]
    parameters: tuple[Entry, ...]
    reset: Entry | None = None
    fall: Entry | None = None
    replay: Entry | None = None
    excitation: Entry | None = None
    notes: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()

    def changed(self, group: str, **values: object) -> "Tables":
        """With other values in one of the single tables."""
        entry = getattr(self, group)
        return replace(self, **{group: replace(entry, values={**entry.values, **values})})


def drive_tables(model: mujoco.MjModel, drives: Sequence[Drive]) -> tuple[Entry, ...]:
    """[[drives]]: one for all joints where all are alike, else one a joint."""
    made = [Entry(_drive_values(model, d), d.said) for d in drives]
    if made and all(e.values == made[0].values for e in made):
        return (Entry({"joint": "*", **made[0].values}, made[0].said),)
    return tuple(Entry({"joint": d.joint, **e.values}, e.said) for d, e in zip(drives, made, strict=True))


def _drive_values(model: mujoco.MjModel, drive: Drive) -> dict[str, object]:
    kinds = {"velocity": "speed"}
    values: dict[str, object] = {"type": kinds.get(drive.kind, drive.kind)}
    if drive.kind in ("position", "torque"):
        values["gain"] = drive.gain
    if drive.kind in ("position", "velocity") and drive.rate_gain > 0:
        values["rate_gain"] = drive.rate_gain
    if drive.kind == "dcmotor":
        values |= {"kt": drive.kt, "resistance": drive.resistance}
    if drive.limit is not None:
        values["torque_limit"] = drive.limit
    elif drive.kind == "position":  # sizes of effects are multiples of it
        values["torque_limit"] = 2.0 * drive.gain * reach_of(model, drive)
    return values


def action_tables(model: mujoco.MjModel, drives: Sequence[Drive]) -> tuple[Entry, ...]:
    """[[actions]], one a drive. Targets have the range that the model's actuator has, else none: see `reach_of`."""
    return tuple(_action(model, d) for d in drives)


def _action(model: mujoco.MjModel, drive: Drive) -> Entry:
    values: dict[str, object] = {"name": drive.action, "unit": action_unit(model, drive)}
    low, high = drive.low, drive.high
    if low is not None and high is not None and low < high:
        values |= {"low": low, "high": high}
    if drive.scale == 1.0 and drive.offset == 0.0:
        return Entry(values)
    return Entry(values, f"{drive.scale:g} times the control of the model's actuator, plus {drive.offset:g}")


def action_unit(model: mujoco.MjModel, drive: Drive) -> str:
    """The unit of a drive's command."""
    way = "rad" if is_hinge(model, model.joint(drive.joint).id) else "m"
    units = {"position": way, "velocity": f"{way}/s", "dcmotor": "V"}
    return units.get(drive.kind, effort_unit(model, drive) if drive.plain else "1")


def effort_unit(model: mujoco.MjModel, drive: Drive) -> str:
    """The unit of the force that a drive gives."""
    return "N*m" if is_hinge(model, model.joint(drive.joint).id) else "N"


def channel_names(model: mujoco.MjModel, base: int, *, logged: bool) -> list[tuple[str, str, float]]:
    """(name, unit, weight) of the channels of a robot: positions, velocities, the base's attitude, height and rates.

    logged : also where the base is and how fast, which only some logs tell.
    """
    joints = scalar_joints(model)
    way = {j: "rad" if is_hinge(model, j) else "m" for j in joints}
    out = [(f"{name_of(model, j)}/position", way[j], 1.0) for j in joints]
    out += [(f"{name_of(model, j)}/velocity", f"{way[j]}/s", 0.0) for j in joints]
    if base >= 0:
        kinds = BASE_CHANNELS | (ODOMETRY if logged else {})
        out += [(f"{name_of(model, base)}/{q}", unit, weight) for q, (unit, weight) in kinds.items()]
    return out


def channel_tables(
    names: Sequence[tuple[str, str, float]], sensed: Mapping[str, Sensed]
) -> tuple[Entry, ...]:
    """[[channels]] with noise and quantum as a log says, else the usual of their unit."""
    out = []
    for name, unit, weight in names:
        values: dict[str, object] = {"name": name, "unit": unit}
        heard = sensed.get(name)
        if heard is None:
            values["noise"] = DEFAULTS[unit]
        else:
            values |= {k: v for k, v in (("noise", heard.noise), ("quantum", heard.quantum)) if v > 0}
        if heard is not None and heard.still:
            weight = 0.0
        if weight != 1.0:
            values["weight"] = weight
        out.append(Entry(values, heard.said if heard else ""))
    return tuple(out)


def keyframe_of(model: mujoco.MjModel) -> int:
    """The keyframe to begin from: one with a usual name, else the first that has a name; -1 where there is none."""
    names = [model.key(k).name.lower() for k in range(model.nkey)]
    usual = [k for word in STANDING for k, name in enumerate(names) if word in name]
    named = [k for k, name in enumerate(names) if name]
    return (usual or named or [-1])[0]
