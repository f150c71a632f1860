"""The answer of `navigate`: timed commands that visit places, and what a model of the robot expects of them."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from dynreg.axes import axes_for
from dynreg.results.comparison import Spread, Way
from dynreg.results.result import Cost, Interval, Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ORDER = ("dx", "dy", "dtheta", "fit", "validation", "test")  # of axes, and of parts, in what is told


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


class CommandLimits(Result):
    """What commands were sought: at most `commands`, each with `seconds` [s] and two values between low and high.

    seconds : the shortest and the longest. low, high : in the order and the units of `Navigation.actions`. beyond :
    whether the longest is longer than 19 of 20 commands of the recording, so that its errors are hardly known.
    """

    commands: int
    seconds: tuple[float, float]
    low: tuple[float, float]
    high: tuple[float, float]
    beyond: bool


class Navigation(Result):
    """Timed commands that visit places, by a model that was made from a recording of the robot.

    on : the model's name; kind, parameters : what it is. parts : commands to fit, to validate and to test. errors :
    {axis: the model's errors on the commands to test}. size : of the squares [m]. area : lowest x and y, highest x and
    y, where the path should stay [m]. back : whether it ends at the start; else in one of the places. actions, units :
    of the values of the commands. seconds : that the plan takes. end : metres from where it should end, in the model.
    drives : simulated ones; each adds the model's errors on consecutive commands to test, as many as the plan has.
    drive_ends : that distance in them: the median, and the 5 % and the 95 % quantile. all_visited : how many of them
    visit every place. way : of the model; ways : of some drives. limits : of the commands. generations : of the search.
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
    limits: CommandLimits
    generations: int
    seed: int
    notes: tuple[str, ...] = ()
    cost: Cost

    @field_validator("errors", "parameters", "parts")
    @classmethod
    def _in_order(cls, told: dict[str, Any]) -> dict[str, Any]:
        """Axes and parts as they are usually told, others by name: a stored document has no order."""
        return dict(
            sorted(
                told.items(), key=lambda one: (ORDER.index(one[0]) if one[0] in ORDER else len(ORDER), one[0])
            )
        )

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
        one = len(self.commands) == 1
        told = (
            f"1 command ({self.seconds:.3g} s) visits"
            if one
            else f"{len(self.commands)} commands ({self.seconds:.3g} s) visit"
        )
        all_of = "it" if every == 1 else "all"
        known = ", which hardly tell of such long commands" if self.limits.beyond else ""
        return (
            f"{self.recording_name}: {told} {there} of {every} {'place' if every == 1 else 'places'} and"
            f" {'ends' if one else 'end'} {distance_words(self.end)} from {self.goal}, says {self.on}. With its"
            f" held-out errors{known}, {self.all_visited} of {self.drives} drives visit {all_of}."
        )


def distance_words(metres: float) -> str:
    """A length with the unit that fits.

    >>> distance_words(0.012), distance_words(2.2), distance_words(8.3e-7)
    ('1.2 cm', '2.2 m', 'under 0.01 cm')
    """
    if metres < 1e-4:
        return "under 0.01 cm"
    return f"{100 * metres:.2g} cm" if 100 * metres < 99.5 else f"{metres:.2g} m"


def _numbers(values: tuple[float | None, ...]) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values])
