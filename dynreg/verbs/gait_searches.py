"""The searches for a gait: one or, once a gait has walked, two that share the rollouts."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from dynreg.gait.forecast import new_does_more
from dynreg.gait.had import Had
from dynreg.gait.near import seek_near
from dynreg.gait.seek import SearchSettings, Sought, seek
from dynreg.gait.trials import Trials
from dynreg.progress import Progress
from dynreg.sim.versions import versions
from dynreg.verbs.gait_simulators import Chosen
from dynreg.verbs.journals import by_these_versions, held
from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True, eq=False)
class Searched:
    """The search whose gait is the answer, and what it found. notes : on the other search."""

    search: SearchSettings
    sought: Sought
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Kept:
    """A search, what makes it this one, and the journal from which it goes on where `resume` is set."""

    search: SearchSettings
    key: Mapping[str, Any]
    path: Path
    resume: bool


@contextmanager
def kept(
    asked: Recorded,
    chosen: Chosen,
    trials: Trials,
    searches: Sequence[SearchSettings],
    had: Had,
    *,
    resume: bool,
) -> Iterator[list[Kept]]:
    """The searches with their journals, which are kept from other runs and removed at the end of the block.

    had : what the first is told of the gaits that the robot has had; where one walked, the best first. resume : whether
    interrupted searches go on. What other versions ran is run again, with a warning. Raises UsageError where another
    run of one of them has not ended.
    """
    # a second one sets out from draws of its own: about gaits that it is told it can find one of them again
    searches = [replace(searches[0], tried=had.genes), *searches[1:]]
    with ExitStack() as locks:
        out = []
        for search in searches:
            key, path = _journal(asked, chosen, trials, search)
            locks.enter_context(held(asked.registry, path, "search for a gait"))
            goes_on = resume and path.is_file() and by_these_versions(path, "gaits of an interrupted search")
            out.append(Kept(search, key, path, goes_on))
        yield out
        for one in out:
            one.path.unlink(missing_ok=True)  # only after the gait is stored


def searched(trials: Trials, searches: Sequence[Kept], had: Had, progress: Progress | None) -> Searched:
    """The answer of one search, or of two: near a gait that walked, and of the whole range.

    had : where one walked, the best first. Raises UsageError as `seek` does, CorruptError for a damaged journal.
    """
    found = []
    for number, one in enumerate(searches, start=1):
        told = _numbered(progress, number, len(searches))
        look = seek_near if one.search.near else seek
        found.append(
            look(trials, one.search, journal=one.path, resume=one.resume, key=one.key, progress=told)
        )
    if len(found) == 1:
        return Searched(searches[0].search, found[0])
    near, new = (one.genes for one in found)
    best = int(new_does_more(trials, had, near, new))
    note = (
        f"two searches shared the rollouts: {found[0].found.evaluations} gaits near the one that walked, and "
        f"{found[1].found.evaluations} in the whole range. The {('first', 'second')[best]} one found this gait"
    )
    return Searched(searches[best].search, found[best], (note,))


def _journal(
    asked: Recorded, chosen: Chosen, trials: Trials, search: SearchSettings
) -> tuple[dict[str, Any], Path]:
    """The key of this search (all that determines it, and the versions that run it), and the path of its journal."""
    key = {
        "robot": asked.robot.hash,
        "recording": asked.recording.id,
        "task": trials.task.name,
        "simulators": tuple(one.id for one in chosen.simulators),
        "values": trials.simulators.values.tolist(),
        **asdict(search),
    }
    name = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:24]
    return {**key, "versions": versions()}, asked.registry.journal_path(name)


def _numbered(progress: Progress | None, number: int, many: int) -> Progress | None:
    """Progress whose stages tell which of several searches they are of."""
    if progress is None or many == 1:
        return progress
    return lambda stage, done, total: progress(f"{stage} {number} of {many}", done, total)
