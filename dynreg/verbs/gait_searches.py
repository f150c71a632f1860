"""The searches for a gait: one or, once a gait has walked, two that share the rollouts."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from dynreg.gait.forecast import new_does_more
from dynreg.gait.had import Had
from dynreg.gait.near import seek_near
from dynreg.gait.seek import SearchSettings, Sought, seek
from dynreg.gait.trials import Trials
from dynreg.progress import Progress
from dynreg.verbs.gait_simulators import Chosen
from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True, eq=False)
class Searched:
    """The search whose gait is the answer, and what it found. journals : of all searches. notes : on the other."""

    search: SearchSettings
    sought: Sought
    journals: tuple[Path, ...]
    notes: tuple[str, ...] = ()


def searched(
    asked: Recorded,
    chosen: Chosen,
    trials: Trials,
    searches: Sequence[SearchSettings],
    had: Had,
    *,
    resume: bool,
    progress: Progress | None,
) -> Searched:
    """The answer of one search, or of two: near a gait that walked, and of the whole range.

    had : where one walked, the best first. resume : whether interrupted searches go on.

    Raises UsageError as `seek` does.
    """
    # a second one sets out from draws of its own: about gaits that it is told it can find one of them again
    searches = [replace(searches[0], tried=had.genes), *searches[1:]]
    found, paths = [], []
    for number, search in enumerate(searches, start=1):
        key, path = _journal(asked, chosen, trials, search)
        told = _numbered(progress, number, len(searches))
        look = seek_near if search.near else seek
        found.append(look(trials, search, journal=path, resume=resume, key=key, progress=told))
        paths.append(path)
    if len(found) == 1:
        return Searched(searches[0], found[0], (*paths,))
    near, new = (one.genes for one in found)
    best = int(new_does_more(trials, had, near, new))
    note = (
        f"two searches shared the rollouts: {found[0].found.evaluations} gaits near the one that walked, and "
        f"{found[1].found.evaluations} in the whole range. The {('first', 'second')[best]} one found this gait"
    )
    return Searched(searches[best], found[best], (*paths,), (note,))


def _journal(
    asked: Recorded, chosen: Chosen, trials: Trials, search: SearchSettings
) -> tuple[dict[str, Any], Path]:
    """The key of this search (all that determines it), and the path of the journal from which it can resume."""
    key = {
        "robot": asked.robot.hash,
        "recording": asked.recording.id,
        "task": trials.task.name,
        "simulators": tuple(one.id for one in chosen.simulators),
        "values": trials.simulators.values.tolist(),
        **asdict(search),
    }
    name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:24]
    return key, asked.registry.journal_path(name)


def _numbered(progress: Progress | None, number: int, many: int) -> Progress | None:
    """Progress whose stages tell which of several searches they are of."""
    if progress is None or many == 1:
        return progress
    return lambda stage, done, total: progress(f"{stage} {number} of {many}", done, total)
