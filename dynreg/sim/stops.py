"""The stops of a model's joints, by which a log's positions in another unit are known."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from dynreg.data.names import parts_of
from dynreg.data.schema import ChannelSpec, RecordingSpec

if TYPE_CHECKING:
    import mujoco

Stops = Mapping[str, tuple[float, float]]


def stops_of(model: "mujoco.MjModel") -> Stops:
    """{joint: lowest and highest position [rad or m]} of the joints that have stops."""
    limited = [j for j in range(model.njnt) if model.jnt_limited[j]]
    return {model.joint(j).name: tuple(map(float, model.jnt_range[j])) for j in limited}


def with_stops(model: "mujoco.MjModel", spec: RecordingSpec) -> RecordingSpec:
    """The spec in which the positions of joints with stops have these."""
    stops = stops_of(model)
    return replace(spec, channels=tuple(_with(channel, stops) for channel in spec.channels))


def _with(channel: ChannelSpec, stops: Stops) -> ChannelSpec:
    joint, quantity = parts_of(channel.name)
    return replace(channel, stops=stops.get(joint)) if quantity == "position" else channel
