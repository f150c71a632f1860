"""Messages on topics and how a robot moved, as an MCAP log for Foxglove."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np

START = 1_700_000_000_000_000_000  # [ns] first stamp of a file: the same run gives the same bytes
NUMBER, TEXT = {"type": "number"}, {"type": "string"}
NUMBERS = {"type": "array", "items": NUMBER}
STAMP = {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}
SCHEMAS = {  # of JSON messages; Foxglove knows them by name
    "sensor_msgs/JointState": {"name": {"type": "array", "items": TEXT}, "position": NUMBERS},
    "dynreg.Channel": {"measured": NUMBER, "simulated": NUMBER, "residual": NUMBER},
    "foxglove.PoseInFrame": {
        "timestamp": {"type": "object", "title": "time", "properties": STAMP},
        "frame_id": TEXT,
        "pose": {
            "type": "object",
            "title": "foxglove.Pose",
            "properties": {
                name: {"type": "object", "properties": {axis: NUMBER for axis in axes}}
                for name, axes in (("position", "xyz"), ("orientation", "xyzw"))
            },
        },
    },
}


@dataclass(frozen=True, eq=False)
class Topic:
    """Messages of one kind. schema : one of SCHEMAS. messages : (time [s], message) in the order of time."""

    name: str
    schema: str
    messages: Iterable[tuple[float, Mapping[str, Any]]]


@dataclass(frozen=True, eq=False)
class Motion:
    """How a robot moved: times (T,) [s], joint angles (T, A) [rad], the base's position (T, 3) [m] and attitude
    (T, 4) as a quaternion x, y, z, w. What is not known is NaN."""

    times: np.ndarray
    joints: np.ndarray
    position: np.ndarray
    attitude: np.ndarray


def joint_states(topic: str, names: Sequence[str], times: np.ndarray, angles: np.ndarray) -> Topic:
    """Joint angles (T, A) [rad] at times (T,) [s]; rows that hold no number are left out."""
    known = np.isfinite(angles).all(axis=1)
    rows = zip(times[known].tolist(), angles[known].tolist(), strict=True)
    return Topic(topic, "sensor_msgs/JointState", [(t, {"name": [*names], "position": q}) for t, q in rows])


def topics(name: str, names: Sequence[str], motion: Motion) -> list[Topic]:
    """The joints, where there are some, and the base of a motion, under /name."""
    moved = [joint_states(f"/{name}/joint_states", names, motion.times, motion.joints)] if names else []
    return [*moved, Topic(f"/{name}/pose", "foxglove.PoseInFrame", _poses(motion))]


def mcap(topics: Sequence[Topic]) -> bytes:
    """An MCAP file of JSON messages, in the order of their stamps."""
    from mcap.writer import Writer

    file = BytesIO()
    writer = Writer(file)
    writer.start(profile="", library="dynreg")
    messages = []
    schemas = {name: 0 for name in dict.fromkeys(topic.schema for topic in topics)}
    for name in schemas:
        described = {"type": "object", "title": name, "properties": SCHEMAS[name]}
        schemas[name] = writer.register_schema(name, "jsonschema", json.dumps(described).encode())
    for topic in topics:
        channel = writer.register_channel(topic.name, "json", schemas[topic.schema])
        messages += [(START + round(t * 1e9), channel, message) for t, message in topic.messages]
    for stamp, channel, message in sorted(messages, key=lambda m: m[0]):
        writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
    writer.finish()
    return file.getvalue()


def _poses(motion: Motion) -> list[tuple[float, dict[str, Any]]]:
    out = []
    for t, position, attitude in zip(motion.times, motion.position, motion.attitude, strict=True):
        if np.isfinite([*position, *attitude]).all():
            pose = {
                "position": dict(zip("xyz", position.tolist(), strict=True)),
                "orientation": dict(zip("xyzw", attitude.tolist(), strict=True)),
            }
            sec, nsec = divmod(START + round(t * 1e9), 1_000_000_000)
            stamp = {"sec": sec, "nsec": nsec}
            out.append((float(t), {"timestamp": stamp, "frame_id": "world", "pose": pose}))
    return out
