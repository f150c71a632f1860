"""What the catalogue tells of robots, recordings and results, without reading what they are."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RobotInfo:
    """A registered robot: its hash, its name, and which version of the robots of this name it is, from 1 on."""

    hash: str
    name: str
    version: int

    def __str__(self) -> str:
        return f"version {self.version} of robot {self.name!r} ({self.hash[:12]})"


@dataclass(frozen=True)
class RecordingInfo:
    """The catalogue's row of a recording, without reading the recording.

    robot_hash : of the robot with which it was ingested last. names : the one that it got last, then the others by
    alphabet. robots : hashes of the robots under which it was ingested with each of these names.
    """

    id: str
    robot_hash: str
    names: tuple[str, ...]
    robots: tuple[str, ...]

    @property
    def name(self) -> str:
        """What it is called with the robot with which it was ingested last."""
        return self.name_with(self.robot_hash)

    def robot_as(self, ref: str) -> str:
        """The hash of the robot that `ref` asks it with: of a name its own, of an id or `@last` the last one."""
        return dict(zip(self.names, self.robots, strict=True)).get(ref, self.robot_hash)

    def name_with(self, robot_hash: str) -> str:
        """The name that it got last with a robot.

        With the robot of its last ingestion, where it got none, that is the beginning of its id: a name of another
        robot would lead there. With a robot that has no part in it, it is the name that it got last of all.
        """
        own = [name for name, robot in zip(self.names, self.robots, strict=True) if robot == robot_hash]
        others = self.names if robot_hash != self.robot_hash else ()
        return next(iter((*own, *others)), self.id[:12])


@dataclass(frozen=True)
class ResultRecord:
    """A stored result: its kind ("neighbours", "diagnosis", ...), the recording it is about, its JSON."""

    id: str
    kind: str
    recording_id: str
    document: dict[str, Any]
