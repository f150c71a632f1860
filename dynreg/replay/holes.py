"""Gaps of a recording: rows in which a signal that a replay needs has no value."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynreg.data.gaps import silences
from dynreg.data.recording import Recording
from dynreg.replay.rows import rows_of
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot


@dataclass(frozen=True)
class Hole:
    """Rows `first` to `last` of a recording's episode (by its number) in which a channel has no value."""

    channel: str
    episode: int
    first: int
    last: int


def holes(robot: Robot, recording: Recording) -> tuple[Hole, ...]:
    """Gaps that cannot be filled, in the commands, the measured inputs and the weighted channels, by episode.

    Only rows between the first and the last measured row of an episode count. The rows between the samples of a slow
    sensor are not a gap (`gaps.silences`). A state that an episode does not have at all is not a gap either; a missing
    command or input is.
    """
    driving = [name for name in (*robot.actions, *robot.inputs) if name in recording.names]
    states = [c.name for c in robot.file.channels if c.weight > 0 and c.name in recording.names]
    out = []
    for number, episode in enumerate(recording.episodes):
        known = np.isfinite(episode.values)
        measured = np.flatnonzero(known[:, recording.columns(states)].any(axis=1))
        for name in dict.fromkeys([*states, *driving]) if len(measured) else ():
            rows = np.flatnonzero(known[:, recording.names.index(name)])
            if len(rows) or name in driving:
                places = _empty(episode.time, rows, measured[0], measured[-1])
                out += [Hole(name, number, first, last) for first, last in places]
    return tuple(out)


def hit(robot: Robot, recording: Recording, cut: Windows, found: Sequence[Hole]) -> np.ndarray:
    """(W,) whether a window overlaps a gap of the recording that it is cut from.

    Their times are compared: windows of robots with control = "timed" count the rows of a grid, not those of the log.
    """
    begin, end = rows_of(robot, recording).spans(cut.episode, cut.rows).T
    out = np.zeros(len(cut), dtype=bool)
    for hole in found:
        time = recording.episodes[hole.episode].time
        out |= (cut.episode == hole.episode) & (begin <= time[hole.last]) & (time[hole.first] <= end)
    return out


def sentence(recording: Recording, found: Sequence[Hole]) -> str:
    """The longest gap in words, and how many more there are."""
    longest = max(found, key=lambda hole: hole.last - hole.first)
    episode = recording.episodes[longest.episode]
    begin, end = episode.time[longest.first], episode.time[longest.last]
    more = f" (and in {len(found) - 1} more places)" if len(found) > 1 else ""
    return (
        f"{longest.channel} has no value in rows {longest.first} to {longest.last} of episode {episode.name!r} "
        f"({begin:.2f} to {end:.2f} s){more}"
    )


def without_start(robot: Robot, recording: Recording) -> str:
    """How many episodes have no row at which a replay can begin, and what they lack, in words; "" for none.

    A start needs every channel that any episode has, whatever its weight: see `Rows.startable`.
    """
    rows = rows_of(robot, recording)
    apart = [number for number, startable in enumerate(rows.startable) if not startable.any()]
    measured = np.array([np.isfinite(states).any(axis=0) for states in rows.states])
    lost = [number for number in apart if measured[number].any()]
    if not lost:
        return ""
    lacks = np.flatnonzero((measured.any(axis=0) & ~measured[lost]).any(axis=0))
    names = ", ".join(robot.channels[column] for column in lacks)
    why = (
        f"they lack {names}, which others have" if names else "in no row of theirs all channels have a value"
    )
    return f"{len(lost)} of {len(rows)} episodes are left out: {why}"


def _empty(time: np.ndarray, known: np.ndarray, begin: int, end: int) -> list[tuple[int, int]]:
    """First and last row of each gap between rows `begin` and `end` of a signal with values in the rows `known`."""
    if not len(known):
        return [(int(begin), int(end))]
    out = []
    for start, stop in silences(time[np.union1d(known, [begin, end])]):
        empty = np.setdiff1d(np.flatnonzero((time >= start) & (time <= stop)), known)
        if len(empty):
            out.append((int(empty[0]), int(empty[-1])))
    return out
