"""Several recordings in one question: joined for one verdict, then fitted one by one."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from dynreg.errors import UsageError

if TYPE_CHECKING:
    from dynreg.data.recording import Recording
    from dynreg.verbs.subjects import Recorded

NUMBER = "recording"  # the setting that tells which recording an episode is of


def parted(name: str, each: "Sequence[Recorded]") -> "tuple[Recorded, str]":
    """Of which recording an episode of joined ones is, NAME/EPISODE, and its own name there."""
    return next(
        (one, episode.name)
        for one in each
        for episode in one.recording.episodes
        if name == f"{one.name}/{episode.name}"
    )


def joined(each: "Sequence[Recorded]") -> "Recorded":
    """All of them as one: the episodes of each, named NAME/EPISODE, over the channels that all have.

    Episodes keep their settings and get one more, `recording`, the number of theirs: so runs of two recordings never
    count as repeats of one. Each recording's time begins at 0: the rests between its own episodes stay, those between
    recordings are not known. The provenance lists the ids and the log files. Raises UsageError for recordings of two
    robots, one recording twice, or recordings of which one lacks channels of the robot that another has.
    """
    first, *others = each
    for other in others:
        if other.robot.hash != first.robot.hash:
            raise UsageError(
                f"{first.name!r} is of robot {first.robot.name!r}, {other.name!r} of {other.robot.name!r}",
                expected="recordings of one robot",
                do="name the robot for all of them with --robot",
            )
    named: dict[str, str] = {}
    for one in each:
        if one.recording.id in named:
            raise UsageError(
                _twice(named[one.recording.id], one.name),
                expected="different recordings",
                do="name each once",
            )
        named[one.recording.id] = one.name
    return replace(
        first, recording=_episodes(each), name="+".join(one.name for one in each), each=tuple(each)
    )


def _twice(first: str, second: str) -> str:
    if first == second:
        return f"recording {first!r} is named twice"
    return f"{first!r} and {second!r} are the same recording"


def _episodes(each: "Sequence[Recorded]") -> "Recording":
    from dynreg.data.recording import Episode, Recording

    robot = each[0].robot
    needed = {*robot.channels, *robot.actions, *robot.inputs}
    shared = [c for c in each[0].recording.channels if all(c in one.recording.channels for one in each)]
    for one in each:
        missing = sorted(({*one.recording.names} & needed) - {c.name for c in shared})
        if missing:
            raise UsageError(
                f"{one.name!r} has channel {missing[0]!r}, which another recording lacks",
                expected="recordings with the same of the robot's channels",
                do="ask about those alone that have it",
            )
    episodes = [
        Episode(
            f"{one.name}/{e.name}",
            e.time - one.recording.episodes[0].time[0],
            e.values[:, one.recording.columns([c.name for c in shared])],
            {**e.settings, NUMBER: float(number)},
        )
        for number, one in enumerate(each)
        for e in one.recording.episodes
    ]
    files = [file for one in each for file in one.recording.provenance.get("files", [])]
    provenance = {"joined": [one.recording.id for one in each], "files": files}
    measured = all(one.recording.measured for one in each)
    return Recording(tuple(shared), tuple(episodes), measured, provenance)
