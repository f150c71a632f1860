"""Robots and recordings as plain data, of which the jobs of an executor are made, and back."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.sim.robot import Robot


def plain_robot(robot: "Robot") -> dict[str, Any]:
    """The files of a robot, and the ranges of its parameters; `robot_from` reads them."""
    ranges = {p.name: (p.low, p.high) for p in robot.space.parameters}
    return {"files": dict(robot.files.files), "folder": str(robot.folder), "ranges": ranges}


def robot_from(told: Mapping[str, Any]) -> "Robot":
    """The robot of which `plain_robot` told."""
    from dataclasses import replace

    from dynreg.folder import Folder
    from dynreg.sim.robot import robot_of

    robot = robot_of(Folder(told["files"]), Path(told["folder"]))
    own = {p.name: (p.low, p.high) for p in robot.space.parameters}
    others = {name: tuple(ends) for name, ends in told["ranges"].items() if own[name] != tuple(ends)}
    return replace(robot, space=robot.space.with_ranges(others)) if others else robot


def plain_recording(recording: "Recording") -> dict[str, Any]:
    """Channels, episodes and provenance of a recording; `recording_from` reads them."""
    episodes = [(e.name, e.time, e.values, dict(e.settings)) for e in recording.episodes]
    channels = [(c.name, c.unit) for c in recording.channels]
    provenance = dict(recording.provenance)
    return {
        "channels": channels,
        "episodes": episodes,
        "measured": recording.measured,
        "provenance": provenance,
    }


def recording_from(told: Mapping[str, Any]) -> "Recording":
    """The recording of which `plain_recording` told, with the same id."""
    from dynreg.data.recording import Channel, Episode, Recording

    channels = tuple(Channel(*one) for one in told["channels"])
    episodes = tuple(Episode(*one) for one in told["episodes"])
    return Recording(channels, episodes, told["measured"], told["provenance"])
