"""Messages on topics and how a robot moved, as an MCAP log for Foxglove."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import merge
from io import BytesIO
from typing import Any

import numpy as np

Message = tuple[float, Mapping[str, Any]]  # time [s], fields
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
    """Messages of one kind. schema : one of SCHEMAS. messages : in the order of time, each given once."""

    name: str
    schema: str
    messages: Iterable[Message]


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
    rows = zip(times[known], angles[known], strict=True)
    messages = ((float(t), {"name": [*names], "position": q.tolist()}) for t, q in rows)
    return Topic(topic, "sensor_msgs/JointState", messages)


def topics(name: str, names: Sequence[str], motion: Motion) -> list[Topic]:
    """The joints, where there are some, and the base of a motion, under /name."""
    moved = [joint_states(f"/{name}/joint_states", names, motion.times, motion.joints)] if names else []
    return [*moved, Topic(f"/{name}/pose", "foxglove.PoseInFrame", _poses(motion))]


def mcap(topics: Sequence[Topic]) -> bytes:
    """An MCAP file of JSON messages, in the order of their stamps; one at a time is held, beside the packed file."""
    from mcap.writer import Writer

    file = BytesIO()
    writer = Writer(file)
    writer.start(profile="", library="dynreg")
    streams = []
    schemas = {name: 0 for name in dict.fromkeys(topic.schema for topic in topics)}
    for name in schemas:
        described = {"type": "object", "title": name, "properties": SCHEMAS[name]}
        schemas[name] = writer.register_schema(name, "jsonschema", json.dumps(described).encode())
    for topic in topics:
        channel = writer.register_channel(topic.name, "json", schemas[topic.schema])
        streams.append(_on(channel, topic.messages))
    for t, channel, message in in_order(*streams):
        writer.add_message(channel, _stamp(t), json.dumps(message).encode(), _stamp(t))
    writer.finish()
    return file.getvalue()


def in_order(*streams: Iterable[tuple]) -> Iterator[tuple]:
    """Streams of tuples that begin with a time [s], each in the order of time, as one; one tuple of each is held."""
    return merge(*streams, key=lambda one: _stamp(one[0]))


def _on(channel: int, messages: Iterable[Message]) -> Iterator[tuple[float, int, Mapping[str, Any]]]:
    return ((t, channel, message) for t, message in messages)


def _stamp(time: float) -> int:
    return START + round(time * 1e9)


def _poses(motion: Motion) -> Iterator[Message]:
    for t, position, attitude in zip(motion.times, motion.position, motion.attitude, strict=True):
        if np.isfinite([*position, *attitude]).all():
            pose = {
                "position": dict(zip("xyz", position.tolist(), strict=True)),
                "orientation": dict(zip("xyzw", attitude.tolist(), strict=True)),
            }
            sec, nsec = divmod(_stamp(t), 1_000_000_000)
            stamp = {"sec": sec, "nsec": nsec}
            yield float(t), {"timestamp": stamp, "frame_id": "world", "pose": pose}
