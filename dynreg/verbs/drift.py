"""Is an earlier recording still true of a robot, and what changed?"""

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import NoMatchError, UsageError
from dynreg.progress import Progress
from dynreg.verbs.diagnose import DiagnoseSettings, horizon, threshold_runs, tolerance, windows
from dynreg.verbs.settings import Settings, option, seed, threads

if TYPE_CHECKING:
    from dynreg.drift.compared import Plan
    from dynreg.results.changes import Changes
    from dynreg.results.drift import Drift
    from dynreg.sim.robot import Robot
    from dynreg.verbs.subjects import Recorded


WHEELS = ("sample", "cells", "level", "welch", "together", "splits")  # settings of robots on wheels alone,
OTHERS = ("effects", "threshold_runs", "tolerance", "horizon", "windows")  # and of all others


@dataclass(frozen=True)
class DriftSettings(Settings):
    """What `drift` can be told. Some settings are of robots on wheels alone, some of all others alone."""

    sample: float = option(0.5, "On wheels: length of a piece of a command [s].", above=0.0)
    cells: int = option(20, "On wheels: cells of wheel speeds on each side.", least=1, most=200)
    level: float = option(0.05, "On wheels: level of the tests.", above=0.0, below=1.0)
    welch: bool = option(False, "On wheels: use Welch's test, for variances that differ.")
    together: bool = option(
        True, "On wheels: keep the false-discovery rate over all tests.", flag="--fdr/--no-fdr"
    )
    splits: int = option(
        200, "On wheels: random halves of the earlier recording that measure false alarms.", least=0
    )
    effects: tuple[str, ...] | None = option(
        None,
        "Without wheels: consider only these effects.",
        usual="all that fit",
        metavar="A,B",
        complete="effect_names",
        some="effects",
        see="effects",
    )
    threshold_runs: int = threshold_runs("Without wheels")
    tolerance: float = tolerance("Without wheels")
    horizon: float | None = horizon("Without wheels")
    windows: int | None = windows("Without wheels")
    seed: int = seed()
    threads: int = threads()

    def meant_for(self, robot: "Robot") -> None:
        """UsageError for a setting that has no meaning for a robot: it would be left unused."""
        on_wheels = by_cells(robot)
        unused, used = (OTHERS, WHEELS) if on_wheels else (WHEELS, OTHERS)
        self.refuse(
            unused,
            f"for robot {robot.name!r}, which has {'a' if on_wheels else 'no'} [base] table",
            f"settings of such a robot: {', '.join(name.replace('_', '-') for name in used)}",
        )

    @property
    def plan(self) -> "Plan":
        """What the numbers are made by."""
        from dynreg.drift.compared import Plan
        from dynreg.timed.table import Rules

        rules = Rules(level=self.level, welch=self.welch, together=self.together)
        return Plan(self.sample, self.cells, rules, self.splits, self.seed)

    @property
    def diagnosis(self) -> "DiagnoseSettings":
        """How recordings of robots without wheels are diagnosed."""
        same = ("effects", "threshold_runs", "tolerance", "horizon", "windows", "seed", "threads")
        return DiagnoseSettings(**{name: getattr(self, name) for name in same})


def drift(
    recent: "Recorded",
    earlier: "Recorded | None",
    settings: DriftSettings,
    *,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> "Drift | Changes":
    """Compare a recording with an earlier one, and store the result.

    Robots on wheels have their displacements tested cell by cell; all others are diagnosed from what a diagnosis of the
    earlier recording found (`verbs.changes`).
    earlier : None for the robot's first recording: by the logs' own clocks where they tell the day, else the one that
    was ingested first, before this one. Where both logs' clocks tell the day, these decide which is the earlier one,
    else what was named does; a note of the result says which. out : a Parquet file for the
    updated displacement table, a row for each sample, with which of them still count.
    What was read from a log on the way is registered, too, the earlier one first; nothing is where there is an error.
    Raises UsageError for recordings of two robots and for a setting without a meaning for this one, NoMatchError where
    there is no earlier one, and what `dynreg.drift.drift` or `diagnose` does.
    """
    settings.meant_for(recent.robot)
    first = earlier or _first(recent)
    _require_one_robot(recent, first)
    order = in_time(recent, first, chosen=earlier is None)
    if not by_cells(recent.robot):
        return _changes(order, settings, earlier is None, out, progress)
    return _displacements(order, settings, earlier is None, out, progress)


def by_cells(robot: "Robot") -> bool:
    """Whether displacements are compared: of a base on two driven wheels. All other robots are diagnosed."""
    return robot.file.base is not None


@dataclass(frozen=True)
class Order:
    """Two recordings, and what decided which of them is the earlier one."""

    recent: "Recorded"
    earlier: "Recorded"
    said: str


def in_time(recent: "Recorded", earlier: "Recorded", *, chosen: bool) -> Order:
    """Both in the order of their logs' clocks, where these tell the day; else as they were named.

    chosen : whether the earlier one was not named.
    """
    begins = earlier.recording.began, recent.recording.began
    if None in begins or begins[0] == begins[1]:
        how = "it was ingested first" if chosen else "--against names it"
        text = (
            f"the logs keep no clock of the day: {earlier.name} is taken for the earlier recording, as {how}"
        )
        return Order(recent, earlier, text)
    if begins[0] > begins[1]:
        recent, earlier = earlier, recent
    told = "by the logs' own clocks {} ({}) is earlier than {} ({})"
    days = (_day(min(begins)), _day(max(begins)))
    text = told.format(earlier.name, days[0], recent.name, days[1])
    if begins[0] > begins[1]:
        text += f", so what changed is told from {earlier.name} to {recent.name}, although --against names the latter"
    return Order(recent, earlier, text)


def _day(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _changes(
    order: Order,
    settings: DriftSettings,
    chosen: bool,
    out: str | Path | None,
    progress: Progress | None,
) -> "Changes":
    from dynreg.verbs.changes import changes

    recent, first = order.recent, order.earlier
    if out is not None:
        raise UsageError(
            f"--out {str(out)!r} for robot {recent.robot.name!r}, which has no [base] table",
            expected="a robot with [base] in robot.toml: others have no table of displacements",
            do="leave --out out",
        )
    result, diagnoses = changes(recent, first, settings.diagnosis, chosen, progress)
    result = result.model_copy(update={"notes": (order.said, *result.notes)})
    first.register()
    for about, diagnosis in diagnoses:
        about.keep(diagnosis)
    recent.keep(result)
    return result


def _displacements(
    order: Order,
    settings: DriftSettings,
    chosen: bool,
    out: str | Path | None,
    progress: Progress | None,
) -> "Drift":
    from dynreg.drift.compared import Held
    from dynreg.drift.drift import drift as held_against
    from dynreg.drift.table import parquet
    from dynreg.verbs.drift_document import document
    from dynreg.verbs.written import write_out

    began, recent, first = time.perf_counter(), order.recent, order.earlier
    old, new = (Held(one.recording, one.name) for one in (first, recent))
    plan = settings.plan
    found = held_against(recent.robot, new, old, plan, progress)
    result = document(recent.robot, new, old, plan, found)
    if out is not None:
        write_out(Path(out), parquet(found))
    told = {"chosen": chosen, "kept": out is not None, "seconds": time.perf_counter() - began}
    told["notes"] = (order.said, *result.notes)
    result = result.model_copy(update=told)
    first.register()
    recent.keep(result)
    return result


def _first(recent: "Recorded") -> "Recorded":
    """The robot's first recording by the logs' own clocks; else the one that was ingested first, before this one.

    NoMatchError where there is none. Where this one is not registered, all others were ingested before it.
    """
    from dynreg.verbs.subjects import recorded

    registry, robot = recent.registry, recent.robot
    infos = [info for info in registry.recordings() if robot.hash in (info.robot_hash, *info.robots)]
    before = [info.id for info in takewhile(lambda info: info.id != recent.recording.id, infos)]
    begun = recent.recording.began
    if begun is not None:
        others = [info.id for info in infos if info.id != recent.recording.id]
        begins = {one: registry.recording(one).began for one in others}
        earlier = sorted((b, one) for one, b in begins.items() if b is not None and b < begun)
        before = [one for _, one in earlier] or [one for one in before if begins[one] is None]
    if not before:
        raise NoMatchError(
            f"no earlier recording of {robot.name!r} in {str(registry.path)!r}",
            expected="one to hold this one against",
            do=f"ingest it with `dynreg ingest LOG --robot {robot.name}`, or name it with --against",
        )
    return recorded(registry, before[0], robot, ingest=False)


def _require_one_robot(recent: "Recorded", earlier: "Recorded") -> None:
    ours, theirs = recent.robot, earlier.robot
    if ours.hash != theirs.hash:
        raise UsageError(
            f"{recent.name!r} is of robot {ours.name!r} ({ours.hash[:12]}), {earlier.name!r} of {theirs.name!r}"
            f" ({theirs.hash[:12]})",
            expected="two recordings of the same robot folder",
            do="name another recording with --against",
        )
