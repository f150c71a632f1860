"""Is an earlier recording still true of a wheeled robot?"""

import time
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import NoMatchError, UsageError
from dynreg.verbs.settings import Settings, option, seed
from dynreg.verbs.verb import Progress

if TYPE_CHECKING:
    from dynreg.drift.compared import Plan
    from dynreg.results.drift import Drift
    from dynreg.verbs.subjects import Recorded


@dataclass(frozen=True)
class DriftSettings(Settings):
    """What `drift` can be told."""

    sample: float = option(0.5, "Seconds of a piece of a command.", above=0.0)
    cells: int = option(20, "Cells of wheel speeds on each side.", least=1, most=200)
    level: float = option(0.05, "Level of the tests.", above=0.0, below=1.0)
    welch: bool = option(False, "Do not take variances for equal.")
    together: bool = option(True, "Keep the false-discovery rate over all tests.", flag="--fdr/--no-fdr")
    splits: int = option(200, "Random halves of the earlier recording to measure false alarms by.", least=0)
    seed: int = seed()

    @property
    def plan(self) -> "Plan":
        """What the numbers are made by."""
        from dynreg.drift.compared import Plan
        from dynreg.timed.table import Rules

        rules = Rules(level=self.level, welch=self.welch, together=self.together)
        return Plan(self.sample, self.cells, rules, self.splits, self.seed)


def drift(
    recent: "Recorded",
    earlier: "Recorded | None",
    settings: DriftSettings,
    *,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> "Drift":
    """A recording held against an earlier one, and the result stored.

    earlier : None for the one of the same robot that was ingested first, before this one. out : a Parquet file for the
    updated displacement table, a row for each sample, with which of them still count.
    What was read from a log on the way is registered, too, the earlier one first; nothing is where there is an error.
    Raises UsageError for recordings of two robots, NoMatchError where there is no earlier one, and what
    `dynreg.drift.drift` does.
    """
    from dynreg.drift.compared import Held
    from dynreg.drift.drift import drift as held_against
    from dynreg.drift.table import parquet
    from dynreg.verbs.drift_document import document
    from dynreg.verbs.written import write_out

    began = time.perf_counter()
    first = earlier or _first(recent)
    _require_one_robot(recent, first)
    old, new = (Held(one.recording, one.name) for one in (first, recent))
    plan = settings.plan
    found = held_against(recent.robot, new, old, plan, progress)
    result = document(recent.robot, new, old, plan, found)
    if out is not None:
        write_out(Path(out), parquet(found))
    told = {"chosen": earlier is None, "kept": out is not None, "seconds": time.perf_counter() - began}
    result = result.model_copy(update=told)
    first.register()
    recent.keep(result)
    return result


def _first(recent: "Recorded") -> "Recorded":
    """The robot's recording that was ingested first; NoMatchError where none was before this one.

    Where this one is not registered, all of them were.
    """
    from dynreg.verbs.subjects import recorded

    registry, robot = recent.registry, recent.robot
    before = takewhile(lambda info: info.id != recent.recording.id, registry.recordings())
    first = next((info for info in before if info.robot_hash == robot.hash), None)
    if first is None:
        raise NoMatchError(
            f"no earlier recording of {robot.name!r} in {str(registry.path)!r}",
            expected="one to hold this one against",
            do=f"ingest it with `dynreg ingest LOG --robot {robot.name}`, or name it with --against",
        )
    return recorded(registry, first.id, ingest=False)


def _require_one_robot(recent: "Recorded", earlier: "Recorded") -> None:
    ours, theirs = recent.robot, earlier.robot
    if ours.hash != theirs.hash:
        raise UsageError(
            f"{recent.name!r} is of robot {ours.name!r} ({ours.hash[:12]}), {earlier.name!r} of {theirs.name!r}"
            f" ({theirs.hash[:12]})",
            expected="two recordings of the same robot folder",
            do="name another recording with --against",
        )
