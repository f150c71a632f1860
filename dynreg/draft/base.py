"""Whether a log measures that the base of a URDF moves, of which the URDF cannot say so."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from dynreg.data.drafting import draft_map
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.data.series import RawLog
from dynreg.data.words import words
from dynreg.draft.entry import DraftOptions, Notes
from dynreg.draft.heard import heard, sensed
from dynreg.draft.opened import BASE
from dynreg.draft.source import Source
from dynreg.draft.urdf import is_urdf

WORLD = "world"  # the link that MuJoCo takes for the world: what is fixed to it stands still
POSE = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}
# 1 sigma of a pose, by unit, that is no motion however small its noise: estimates of a pose at rest drift as far.
DRIFT = {"m": 0.005, "rad": 0.01}
# Words of signals that are of the robot's base itself,
OF_BASE = frozenset(("odom", "odometry", "base", "torso", "trunk", "pelvis", "body"))
SEEN = frozenset(("imu", "mocap", "vicon"))  # and of those that may be of any link, such as a tool
_FRAMES = re.compile(r"\[(?P<parent>[^\]]*)->(?P<child>[^\]]*)\]$")


def with_base(source: Source, options: DraftOptions, log: RawLog | None, notes: Notes) -> DraftOptions:
    """The options with a free base where nothing states one, no joint holds the URDF's to a world, and the log's moves.

    Where the log's signal may be of another link, or what would be free has no mass, the base stays fixed and the notes
    say so.
    """
    text = source.files[source.model].decode("utf-8", errors="replace")
    if log is None or options.free_base is not None or not is_urdf(text):
        return options
    robot = ET.fromstring(text)
    held = _held(robot)
    if held is None:
        return options
    sure = _moving(log, (name for name in log.sources if _of_base(log, name, robot, held)))
    seen = sure or _moving(log, (name for name in log.sources if SEEN & {*words(_told(log, name))}))
    if not seen:
        return options
    if not sure or not _weighs(robot, held):
        notes.add(
            f"the log measures a base that moves ({seen}), and this base is fixed: --free-base lets it move"
        )
        return options
    notes.add(
        f"the log measures a base that moves ({seen}), and no joint of the URDF holds it to a world: it moves freely. "
        "--fixed-base keeps it fixed"
    )
    return replace(options, free_base=True)


def _held(robot: ET.Element) -> set[str] | None:
    """The root link and all that is fixed to it; None where a joint says how the root stands in its world."""
    joints = [
        (j.get("type", ""), p.get("link", ""), c.get("link", ""))
        for j in robot.findall("joint")
        if (p := j.find("parent")) is not None and (c := j.find("child")) is not None
    ]
    roots = _links(robot) - {child for _, _, child in joints}
    if len(roots) != 1 or roots == {WORLD} or any(kind in ("floating", "planar") for kind, _, _ in joints):
        return None
    held, before = roots, set[str]()
    while held != before:
        before = held
        held = before | {child for kind, parent, child in joints if kind == "fixed" and parent in before}
    return held


def _links(robot: ET.Element) -> set[str]:
    return {link.get("name", "") for link in robot.findall("link")}


def _weighs(robot: ET.Element, held: set[str]) -> bool:
    """Whether the links have a mass: MuJoCo refuses what moves freely without one."""
    masses = [m for link in robot.findall("link") if link.get("name") in held for m in link.iter("mass")]
    with suppress(ValueError):  # MuJoCo tells what is wrong with what is no number
        return any(float(mass.get("value", "0")) > 0 for mass in masses)
    return False


def _told(log: RawLog, name: str) -> str:
    """What says whose a signal is: its topic, in tables its own name."""
    return log.topic_of(name) or name


def _of_base(log: RawLog, name: str, robot: ET.Element, held: set[str]) -> bool:
    """Whether a signal is of the robot's base; of a transform, where it leads from elsewhere to the base.

    It is not where a joint has its name: the first of an arm may be called base_yaw.
    """
    told = _told(log, name)
    said = {*words(told)}
    if any({*words(joint.get("name", ""))} <= said for joint in robot.findall("joint") if _turns(joint)):
        return False
    if frames := _FRAMES.search(told):
        return frames["child"].strip("/") in held and frames["parent"].strip("/") not in _links(robot)
    return bool(OF_BASE & said)


def _turns(joint: ET.Element) -> bool:
    """Whether a joint moves."""
    return joint.get("type") != "fixed"


def _moving(log: RawLog, names: Iterable[str]) -> str:
    """The topic or column of a pose among signals that moves further than its noise and its drift; "" for none."""
    part = replace(log, sources={name: log.sources[name] for name in names})
    channels = tuple(ChannelSpec(f"{BASE}/{at}", unit, "state", optional=True) for at, unit in POSE.items())
    drafted = draft_map(part, RecordingSpec(BASE, channels, (), None))
    series = heard(drafted).series
    for channel in channels:
        one = series.get(channel.name)
        seen = sensed(one, channel.unit) if one is not None else None
        if seen is not None and not seen.still and np.nanstd(one.values) > DRIFT[channel.unit]:
            source = drafted.sources[channel.name].keys["source"]
            first = source if isinstance(source, str) else source[0]
            return log.topic_of(first if first in log.sources else f"{first}.x") or first
    return ""
