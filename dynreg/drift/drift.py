"""A recording held against an earlier one: tests, patterns, rates of error, and which samples still count."""

from dataclasses import dataclass

import numpy as np

from dynreg.drift.compared import Compared, Held, Plan, compared
from dynreg.errors import RobotError, UsageError
from dynreg.progress import Progress
from dynreg.rng import stream
from dynreg.sim.robot import Robot
from dynreg.timed.drift import (
    Judged,
    Shifts,
    Split,
    apart_at,
    change_by_cell,
    explained,
    rivals,
    shifts,
    split_against_itself,
)
from dynreg.timed.table import updated


@dataclass(frozen=True, eq=False)
class Drifted:
    """What was found of two recordings.

    order : patterns, the best first. clear : those of them that explain what moved, more than one where they cannot be
    told apart; apart : then commands by which they can, see `timed.drift.apart_at`. itself : None where the earlier
    recording was not split. counts : (n + m, 3) which samples still count, the earlier ones first.
    """

    both: Compared
    shifts: Shifts
    order: tuple[Judged, ...]
    clear: tuple[str, ...]
    apart: tuple[tuple[float, float, float, bool], ...]
    itself: Split | None
    counts: np.ndarray

    @property
    def tests(self) -> int:
        """How many there were."""
        return int(np.isfinite(self.shifts.p).sum())

    @property
    def rejected(self) -> int:
        """How many of the tests the rules reject."""
        return int(self.shifts.rejected.sum())

    @property
    def verdict(self) -> str:
        """Whether the earlier recording is "still true", has "moved", or there is "too little data"."""
        if not self.tests:
            return "too little data"
        return "moved" if self.rejected or self.clear else "still true"


def drift(robot: Robot, recent: Held, earlier: Held, plan: Plan, progress: Progress | None = None) -> Drifted:
    """A recording held against an earlier one of the same robot.

    Raises RobotError for a robot without wheels, LogError for recordings without a pose or without pieces of
    `plan.sample` seconds, UsageError for one recording twice.
    """
    report = progress or (lambda *_: None)
    if robot.file.base is None:
        raise RobotError(
            f"robot {robot.name!r} has no wheels of which one could have changed",
            expected="[base] in robot.toml",
            do="name a recording of a robot on two wheels, such as 'diffdrive'",
        )
    if recent.recording.id == earlier.recording.id:
        raise UsageError(
            f"{recent.name!r} against itself",
            expected="another recording, made before",
            do="name the earlier one with --against",
        )
    report("displacements", 0, 3)
    both, rules = compared(robot, recent, earlier, plan), plan.rules
    old, new = both.old.table(both.grid, both.old_off), both.new.table(both.grid, both.new_off)
    found = shifts(old, new, rules)
    report("displacements", 1, 3)
    order = explained(found, change_by_cell(both.reference, both.new, both.grid))
    clear = rivals(order)
    apart = apart_at(found, order, both.reference, both.grid, plan.sample) if len(clear) > 1 else ()
    report("displacements", 2, 3)
    rng = stream(plan.seed, "drift", "splits")
    itself = split_against_itself(both.old, both.old_off, both.grid, both.reference, rules, plan.splits, rng)
    report("displacements", 3, 3)
    after, _ = updated(old, new.cell, new.values, 1, rules)
    return Drifted(both, found, order, clear, apart, itself, after.counts)
