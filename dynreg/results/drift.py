"""The answer of `drift`: whether a recording of a wheeled robot is still true of it, and what changed."""

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from dynreg.axes import axes_for, chosen, with_intervals
from dynreg.results.result import Result

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes

HALF = 0.5  # of the squared shifts: a pattern that explains less is told with its share


class Shift(Result):
    """The change of the displacement of a cell's commands on one axis, in `unit`, with its standard error.

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

    Factors are searched from 0.2 to 5, and intervals end there. The interval is the whole range where the shifts do not
    depend on the factor. at_bound : the factor is at an end of the range, and a better one may lie beyond. evidence :
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

    known : the earlier recording has samples of such commands, with which new ones can be compared.
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
    """The tested part of a recording: samples (commands held for a while), and the pieces that they are made of.

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
    """A recording compared with an earlier one of the same robot.

    cells : all that were tested, the strongest shift first. pattern : the one that explains the shifts, null where none
    is clear; rivals : patterns that explain them as well; separate_by : commands that separate these. sample [s], grid
    : cells on each side, low, high [m/s] : of the wheel speeds. reference : the model that the displacements are
    compared with, fitted to the earlier recording. chosen : the earlier recording was not named, but the first. kept :
    the updated table was written.
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

    def plot(
        self, what: Literal["factors", "dx", "dy", "dtheta"] = "factors", ax: "Axes | None" = None
    ) -> "np.ndarray":
        """The factor of each pattern with its 95 % interval, or a map of what moved; (1,) matplotlib axes.

        what : "factors"; or an axis of the displacement, whose shift in each cell of wheel speeds [m/s] is drawn, with
        a star where its test is rejected. Raises UsageError where no cell was tested, and for another word.
        """
        chosen(("factors", "dx", "dy", "dtheta"), what, "plot of")
        places = axes_for(
            min(1, len(self.cells)), ax, what="tested cells", height=2.5 if what == "factors" else 4.0
        )
        if what == "factors":
            shown = [p for p in reversed(self.patterns) if p.name != "no change"]
            with_intervals(places[0], [p.name for p in shown], [(p.factor, p.low, p.high) for p in shown])
            places[0].axvline(1.0, color="black", linestyle=":")
            places[0].set(xlabel="factor", title=f"{self.recording_name} against {self.earlier.name}")
        else:
            self._draw_map(places[0], what)
        return places

    def _draw_map(self, ax: "Axes", axis: str) -> None:
        shifts = [c.shifts[axis] for c in self.cells]
        end = max(abs(s.value) for s in shifts) or 1.0
        look = {"s": 200, "marker": "s", "cmap": "coolwarm", "vmin": -end, "vmax": end}
        left, right = [c.left for c in self.cells], [c.right for c in self.cells]
        dots = ax.scatter(left, right, c=[s.value for s in shifts], **look)
        stars = [(c.left, c.right) for c, s in zip(self.cells, shifts, strict=True) if s.rejected]
        ax.plot([x for x, _ in stars], [y for _, y in stars], "k*")
        ax.figure.colorbar(
            dots, ax=ax, label=f"{axis} in {self.sample:g} s, more than before [{shifts[0].unit}]"
        )
        ax.set(xlabel="left wheel told [m/s]", ylabel="right wheel told [m/s]", aspect="equal")
        ax.set_title(f"{self.recording_name} against {self.earlier.name} (* rejected)")

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
