"""The parts of a recording that a simulator was fitted to or chosen by; windows where they can be cut again."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dynreg.replay.cut import unbroken, usual_horizon, windows
from dynreg.replay.parts import names
from dynreg.replay.rows import rows_of

if TYPE_CHECKING:
    from dynreg.replay.windows import Windows
    from dynreg.verbs.simulator import Simulator
    from dynreg.verbs.subjects import Recorded

Seen = Callable[[str, float, float], bool]


def seen(asked: "Recorded", one: "Simulator") -> Seen:
    """Whether a simulator, or one that it came from, has seen rows of an episode (its name) between two times [s].

    Times are on the episode's clock. An episode that was cut into windows and fitted to in part is seen whole, unless
    its result's windows can be cut again. Where it was fitted to the recording and nothing says to which part, it has
    seen all of it.
    """
    if one.fitted_to is None:
        return lambda episode, begin, end: True
    if not one.fitted_to:
        return lambda episode, begin, end: episode in one.inherited
    held_out = _spans(asked, one)

    def known(episode: str, begin: float, end: float) -> bool:
        own = episode in one.fitted_to and not any(
            name == episode and first <= begin and end <= last for name, first, last in held_out
        )
        return own or episode in one.inherited

    return known


def held_out(asked: "Recorded", one: "Simulator") -> "Windows | None":
    """The windows that the simulator's result held out, cut again as that cut them; None where that cannot be."""
    told = {name for part in (one.parts or {}).values() for name in part}
    for cut in _cuts(asked, one.asked.get("horizon")):
        every = names(asked.recording, cut, np.ones(len(cut), dtype=bool))
        # a diagnosis of at most so many windows names those alone; that it is this cut, its horizon says
        if told == {*every} or (one.asked.get("windows") and told < {*every}):
            return cut.take(np.array([n in one.parts["test"] for n in every], dtype=bool))
    return None


def _spans(asked: "Recorded", one: "Simulator") -> list[tuple[str, float, float]]:
    """(episode, begin, end) [s] of the windows that the simulator's result held out; windows in a row are one."""
    cut = held_out(asked, one)
    return [] if cut is None else _joined(asked, cut)


def _cuts(asked: "Recorded", horizon: float | None) -> "list[Windows]":
    """The recording as a diagnosis cuts it that was told this horizon [s] or none, and as a query does."""
    robot, recording = asked.robot, asked.recording
    short = unbroken(robot, recording, usual_horizon(robot, horizon))
    return [short, windows(robot, recording)]


def _joined(asked: "Recorded", cut: "Windows") -> list[tuple[str, float, float]]:
    spans, out = rows_of(asked.robot, asked.recording).spans(cut.episode, cut.rows).tolist(), []
    for number, (begin, end) in sorted(zip(cut.episode.tolist(), spans, strict=True)):
        name = asked.recording.episodes[number].name
        if out and out[-1][0] == name and out[-1][2] == begin:
            out[-1] = (name, out[-1][1], end)
        else:
            out.append((name, begin, end))
    return out
