"""The answer of `drift`: whether a recording of a wheeled robot is still true of it, and what moved."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result

HALF = 0.5  # of the squared shifts: a pattern that explains less is told with its share


class Shift(Result):
    """What the commands of a cell move more than they did on one axis, in `unit`, with its standard error.

    p : of the test. sigmas : the normal deviate that is as rare, with the shift's sign. rejected : by the rules.
    """

    value: float
    error: float
    unit: str
    p: float
    sigmas: float
    rejected: bool


class DriftCell(Result):
    """A cell that was tested: its middle [m/s], samples in the earlier recording and in this one, shifts by axis."""

    left: float
    right: float
    earlier: int
    recent: int
    shifts: dict[str, Shift]


class DriftPattern(Result):
    """An explanation of all shifts: a factor with its 95 % interval, the share of the squared shifts explained.

    Factors are looked for from 0.2 to 5, and the interval ends there: all of it where the shifts say nothing of the
    factor. at_bound : the factor stands at such an end, and what explains the shifts best may lie beyond. evidence :
    Schwarz's criterion of no change less its own; 10 is very strong.
    """

    name: Literal["no change", "left wheel", "right wheel", "all speeds", "turns only"]
    factor: float
    low: float
    high: float
    share: float
    evidence: float
    at_bound: bool = False


class Separating(Result):
    """A command [m/s] by whose displacement the two best patterns differ, by so many deviations of one sample.

    known : the earlier recording has samples of such commands, so that new ones can be held against them.
    """

    left: float
    right: float
    apart: float
    known: bool


class FalseAlarms(Result):
    """How often the test errs: as it should, and in the earlier recording split in two at random.

    expected : tests that would be rejected one by one, at the level, if nothing had moved. splits : of the earlier
    recording, by whole episodes or commands, each tested like the two recordings, with half of the samples; they share
    their data, so that shares scatter more than by chance alone. one_by_one : share of their tests below the level.
    alarms : share of splits with any alarm. Null where halves are too small.
    """

    level: float
    expected: float
    splits: int
    by: Literal["episodes", "commands"] | None
    tests: float | None
    one_by_one: float | None
    alarms: float | None


class Taken(Result):
    """What of a recording was tested: samples (commands held for a while), the pieces that they are made of.

    short, long, outside : pieces that were left out, too short, too long for a sample, or beyond the cells.
    """

    recording: str
    name: str
    samples: int
    pieces: int
    short: int
    long: int
    outside: int


class Drift(Result):
    """A recording held against an earlier one of the same robot.

    cells : all that were tested, the strongest shift first. pattern : the one that explains the shifts, null where
    none is clear; rivals : where it cannot be told from others, those, and separate_by what commands would tell.
    sample [s], grid : cells on each side, low, high [m/s] : of the wheel speeds. reference : what the displacements
    are held against, fitted to the earlier recording. chosen : the earlier recording was not named, but the first.
    kept : the updated table was written.
    """

    schema_: Literal["dynreg/drift/1"] = Field(default="dynreg/drift/1", alias="schema")
    robot: str
    recording: str
    recording_name: str
    earlier: Taken
    recent: Taken
    chosen: bool
    verdict: Literal["still true", "moved", "too little data"]
    test: Literal["student", "welch"]
    together: bool
    tests: int
    rejected: int
    false_alarms: FalseAlarms
    pattern: str | None
    rivals: tuple[str, ...]
    separate_by: tuple[Separating, ...]
    patterns: tuple[DriftPattern, ...]
    cells: tuple[DriftCell, ...]
    sample: float
    grid: int
    low: float
    high: float
    reference: dict[str, float]
    seed: int
    notes: tuple[str, ...]
    seconds: float
    kept: bool = False

    @property
    def moved(self) -> tuple[DriftCell, ...]:
        """The cells with a rejected test, the strongest first."""
        return tuple(c for c in self.cells if any(s.rejected for s in c.shifts.values()))

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"left": c.left, "right": c.right, "axis": axis, **shift.to_dict()}
            for c in self.cells
            for axis, shift in c.shifts.items()
        ]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        rejected = [row for row in self.rows() if row["rejected"]]
        return {"": [p.to_dict() for p in self.patterns], "rejected": rejected}

    def __str__(self) -> str:
        if self.verdict == "too little data":
            return (
                f"{self.recording_name} cannot be held against {self.earlier.name}: no cell of wheel speeds has two"
                f" samples in both"
            )
        tests = f"{self.rejected} of {self.tests} tests rejected"
        if self.verdict == "still true":
            return f"{self.earlier.name} is still true of {self.robot} in {self.recording_name}: {tests}"
        return f"{self.earlier.name} is no longer true of {self.robot} in {self.recording_name}: {tests}; {self._why()}"

    def _why(self) -> str:
        by_name = {p.name: p for p in self.patterns}
        if self.pattern is not None:
            p = by_name[self.pattern]
            end = ", at a bound of the search" if p.at_bound else ""
            most = f", {100 * p.share:.0f} % of the squared shifts" if p.share < HALF else ""
            return f"{p.name} x {p.factor:.3f} [{p.low:.3f}, {p.high:.3f}]{end}{most}"
        if self.rivals:
            told = [f"{name} x {by_name[name].factor:.3f}" for name in self.rivals]
            return f"{' or '.join(told)}, which these commands cannot tell apart"
        return "no pattern explains what moved"
