"""The answer of `navigate`: timed commands that visit places, and what a model of the robot expects of them."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from dynreg.axes import axes_for
from dynreg.results.comparison import Spread, Way
from dynreg.results.result import Cost, Interval, Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Place(Result):
    """The middle of a square to visit, ahead of the start (x) and to its left (y) [m].

    visited : whether the path of the model gets into it. drives : how many of the simulated drives do.
    """

    x: float
    y: float
    visited: bool
    drives: int

    def outline(self, size: float) -> tuple[list[float], list[float]]:
        """x and y of the corners of the square, all the way round."""
        half = size / 2
        return (
            [self.x + side * half for side in (-1, 1, 1, -1, -1)],
            [self.y + side * half for side in (-1, -1, 1, 1, -1)],
        )


class TimedCommand(Result):
    """One command: when it begins and how long it holds [s], and its values, in the order of `Navigation.actions`."""

    time: float
    seconds: float
    values: tuple[float, float]


class Navigation(Result):
    """Timed commands that visit places, by a model that was made from a recording of the robot.

    on : the model's name; kind, parameters : what it is. parts : commands to fit, to validate and to test. errors :
    {axis: the model's errors on the commands to test}. size : of the squares [m]. area : lowest x and y, highest x and
    y, where the path should stay [m]. back : whether it ends at the start; else in one of the places. actions, units :
    of the values of the commands. seconds : that the plan takes. end : metres from where it should end, in the model.
    drives : simulated ones; each adds the model's errors on consecutive commands to test, as many as the plan has.
    drive_ends : that distance in them: the median, and the 5 % and the 95 % quantile. all_visited : how many of them
    visit every place. way : of the model; ways : of some drives. generations : of the search.
    """

    schema_: Literal["dynreg/navigation/1"] = Field(default="dynreg/navigation/1", alias="schema")
    robot: str
    recording: str
    recording_name: str
    on: str
    kind: str
    parameters: dict[str, float]
    parts: dict[str, int]
    errors: dict[str, Spread]
    size: float
    area: tuple[float, float, float, float]
    back: bool
    places: tuple[Place, ...]
    actions: tuple[str, str]
    units: tuple[str, str]
    commands: tuple[TimedCommand, ...]
    seconds: float
    end: float
    drives: int
    drive_ends: Interval
    all_visited: int
    way: Way
    ways: tuple[Way, ...]
    generations: int
    seed: int
    notes: tuple[str, ...] = ()
    cost: Cost

    @property
    def goal(self) -> str:
        """Where the path should end, in words."""
        return "the start" if self.back else "the nearest place" if len(self.places) > 1 else "the place"

    def rows(self) -> list[dict[str, Any]]:
        """The table that a robot plays: a row for each command, and one that stops it in the end."""
        stop = TimedCommand(time=self.seconds, seconds=0.0, values=(0.0, 0.0))
        return [
            {"time": c.time, "seconds": c.seconds, **dict(zip(self.actions, c.values, strict=True))}
            for c in (*self.commands, stop)
        ]

    @property
    def csv(self) -> str:
        """The rows as the text of a CSV file."""
        return self.to_frame().to_csv(index=False, lineterminator="\n")

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        return {"commands": self.rows(), "places": [place.to_dict() for place in self.places]}

    def plot(self, ax: "Axes | None" = None) -> "np.ndarray":
        """The path of the model, those of some drives and the places, from above [m]; (1,) matplotlib axes."""
        (place,) = places = axes_for(1, ax, what="paths", height=5.0)
        for way in self.ways:
            place.plot(_numbers(way.x), _numbers(way.y), color="#8a94a0", alpha=0.5, linewidth=1.0)
        place.plot(_numbers(self.way.x), _numbers(self.way.y), color="#0b63ce", label=self.on)
        for square in self.places:
            place.plot(*square.outline(self.size), color="#2f8f46" if square.visited else "#c2255c")
        place.plot(0.0, 0.0, "o", color="#1b1f24")
        place.set(
            xlabel="ahead [m]", ylabel="to the left [m]", title=f"plan for {self.robot}", aspect="equal"
        )
        place.legend(fontsize="small")
        return places

    def __str__(self) -> str:
        there, every = sum(place.visited for place in self.places), len(self.places)
        return (
            f"{self.recording_name}: {len(self.commands)} commands ({self.seconds:.3g} s) visit {there} of {every}"
            f" {'place' if every == 1 else 'places'} and end {100 * self.end:.2g} cm from {self.goal}, says"
            f" {self.on}. With its held-out errors, {self.all_visited} of {self.drives} drives visit"
            f" {'it' if every == 1 else 'all'}."
        )


def _numbers(values: tuple[float | None, ...]) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values])
