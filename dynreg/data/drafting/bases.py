"""Which signal of a log is which channel of a base: its pose, its attitude in angles or quaternions, its motion."""

import json
import re
from collections.abc import Sequence

import numpy as np

from dynreg.data.attitude import ANGLES, LEAST
from dynreg.data.drafting.offers import Offer
from dynreg.data.drafting.source import Source, best
from dynreg.data.names import quantity_of
from dynreg.data.schema import ChannelSpec
from dynreg.data.words import words

_BETTER = {  # topics by the words in them, the first the better
    "pose": ("mocap", "vicon", "truth", "ground", "odom", "pose", "imu", "tf"),
    "tilt": ("mocap", "vicon", "truth", "ground", "imu", "odom", "pose", "tf"),
    "rate": ("imu", "odom"),
}
# the first item of a quaternion in a list
_LISTED = re.compile(r"(.*(?:quat|orientation)[^\[\]]*)\[0\]", re.IGNORECASE)
ALIKE = 0.1  # of a unit quaternion's parts, and of their squares: nearer to each other, they do not tell the order


def of_base(offers: Sequence[Offer], channel: ChannelSpec) -> Source | None:
    """What a free or wheeled base measures or is told: pose, Euler angles, velocities in its own frame."""
    what = quantity_of(channel.name)
    if what in ANGLES and channel.unit == "rad":
        return _angle(offers, channel, what)
    patterns = _patterns(what, channel.kind)
    if patterns is None:
        return None
    order, shapes = patterns
    rated = []
    for offer in offers:
        place = next((i for i, s in enumerate(shapes) if re.search(s, offer.source)), None)
        if place is not None and offer.command == (channel.kind == "action"):
            rated.append((_place(offer.topic, order) * 10 + place, offer))
    return best(rated, channel)


def _patterns(what: str, kind: str) -> tuple[str, tuple[str, ...]] | None:
    if kind == "action":
        motion = {"speed_command": "linear.x", "yaw_rate_command": "angular.z"}.get(what)
        table = {
            "speed_command": r"(^|[._/])v(_cmd|_command)$",
            "yaw_rate_command": r"(^|[._/])w(_cmd|_command)$",
        }
        return ("rate", (rf"\.{re.escape(motion)}$", table[what])) if motion else None
    if what in ("speed", "yaw_rate"):
        what = {"speed": "vx", "yaw_rate": "wz"}[what]
    axis = what[-1:]
    if axis not in ("x", "y", "z"):
        return None
    if what == axis:
        return "pose", (rf"\.position\.{axis}$", rf"\.translation\.{axis}$", rf"^(base_|pos_|p)?{axis}$")
    index = "xyz".index(axis)
    if what == f"v{axis}":
        shapes = (
            rf"\.twist\.linear\.{axis}$",
            rf"\.linear_velocity\.{axis}$",
            rf"^(base_)?(v|lin_vel_){axis}$",
        )
        return "rate", shapes
    if what == f"w{axis}":
        shapes = (
            rf"\.angular_velocity\.{axis}$",
            rf"\.twist\.angular\.{axis}$",
            rf"(^|[._/])gyro(scope)?(\[{index}\]|\.{axis})$",
            rf"^(base_)?(w|gyro_|ang_vel_){axis}$",
        )
        return "rate", shapes
    return None


def _angle(offers: Sequence[Offer], channel: ChannelSpec, what: str) -> Source | None:
    """An angle that is logged as such, else of the quaternion that is the likeliest to be the base's."""
    wanted = rf"(^|[._/])(base_|torso_|body_)?{what}$|[._/](rpy|euler)\[{ANGLES.index(what)}\]$"
    plain = [(0, o) for o in offers if re.search(wanted, o.source) and not o.command]
    if plain:
        source = best(plain, channel)
        if source is not None:
            return Source({**source.keys, **({"unwrap": True} if what == "yaw" else {})}, source.notes)
    found = _quaternions(offers)
    if not found:
        return None
    order = "pose" if what == "yaw" else "tilt"
    first, *others = sorted(found, key=lambda f: (not f[2], _place(f[0], order)))
    keys = {"source": first[1], "angle": what, **({"unwrap": True} if what == "yaw" else {})}
    note = f"also to be had from {', '.join(json.dumps(o[1]) for o in others[:3])}"
    return Source(keys, (*first[3], *([note] if others else [])))


def _quaternions(offers: Sequence[Offer]) -> list[tuple[str, str | list[str], bool, tuple[str, ...]]]:
    """Where each quaternion is, its source in a map, whether it ever changes, and notes on it."""
    by_name = {o.source: o for o in offers}
    out: list[tuple[str, str | list[str], bool, tuple[str, ...]]] = []
    for name, offer in by_name.items():
        if offer.command:
            continue
        listed, stem, notes = _LISTED.fullmatch(name), name.removesuffix("w"), ()
        if listed:
            parts = [by_name.get(f"{listed[1]}[{i}]") for i in range(4)]
        elif stem != name:
            parts = [by_name.get(stem + part) for part in "wxyz"]
        else:
            continue
        if None in parts or listed and f"{listed[1]}[4]" in by_name:
            continue
        if listed:
            parts, *notes = _ordered(parts)
        source = stem[:-1] if stem.endswith(".") else [part.source for part in parts]
        out.append((offer.topic or offer.path, source, any(part.moves for part in parts), tuple(notes)))
    return out


def _ordered(parts: Sequence[Offer]) -> tuple[list[Offer], str]:
    """The four items of a list as w, x, y and z, and what a comment says of their order.

    Of a robot that stands upright x and y are small, however it is turned; and w is the largest of the four unless it
    is turned by more than a right angle.
    """
    rows = min(len(part.series) for part in parts)
    values = np.stack([part.series.values[:rows] for part in parts])
    length = np.linalg.norm(values, axis=0)
    known = np.flatnonzero(np.isfinite(length) & (length > LEAST))
    q = np.abs(values[:, known[0]] / length[known[0]]) if len(known) else np.zeros(4)
    # by how much x and y would be larger with w last; then by how much the first item is larger than the last
    tells = q[0] ** 2 - q[2] ** 2, q[0] - q[3]
    told = next((told for told in tells if abs(told) > ALIKE), 0.0)
    ordered, place = ([*parts[3:], *parts[:3]], "last") if told < 0 else ([*parts], "first")
    if told:
        return ordered, f"w is taken for the {place} of the four: so the robot stands upright at the start"
    return (
        ordered,
        "w may be the first or the last of the four: the start does not tell, so first, as in MuJoCo",
    )


def _place(topic: str, order: str) -> int:
    told = words(topic)
    ranks = _BETTER[order]
    return next((i for i, word in enumerate(ranks) if word in told), len(ranks))
