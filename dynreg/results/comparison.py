"""The answer of `compare`: the held-out error of each simulator, and of models of a wheeled robot's commands."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from dynreg.axes import STYLES, axes_for, chosen
from dynreg.results.result import Cost, Result
from dynreg.results.rollouts import Rollouts, Score

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Spread(Result):
    """The spread of absolute errors, in `unit`."""

    mean: float
    min: float
    max: float
    sd: float
    unit: str


class Pair(Result):
    """Two models on one axis: mean error of the first less that of the second, with its 95 % interval (Tukey).

    tukey : p-value for all pairs together; it takes the models' errors for independent samples, as the paper does.
    paired : p-value on the same commands, corrected by Holm for all pairs of the axis: the larger of Wilcoxon's, for
    independent commands, and of Student's over ten stretches of commands in a row. In older documents Wilcoxon's alone.
    """

    axis: str
    first: str
    second: str
    difference: float
    low: float
    high: float
    unit: str
    tukey: float
    paired: float


class Variance(Result):
    """One-way analysis of variance of the absolute errors on one axis.

    f : null where it is infinite: no model's errors vary, and the models differ; then p is 0.
    """

    axis: str
    f: float | None
    between: int
    within: int
    p: float


class Errors(Result):
    """Models of a wheeled robot on commands that none of them was fitted to.

    models : {name: {axis: errors}}. displacements : {axis: mean absolute displacement}. seen : simulators that may have
    been fitted to some of the commands: they are in no pair. Empty in older documents.
    """

    commands: int
    models: dict[str, dict[str, Spread]]
    displacements: dict[str, float]
    variance: tuple[Variance, ...]
    pairs: tuple[Pair, ...]
    seen: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"model": name, "axis": axis, **spread.to_dict()}
            for name, axes in self.models.items()
            for axis, spread in axes.items()
        ]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        return {
            "errors": self.rows(),
            "analysis of variance": [v.to_dict() for v in self.variance],
            "pairs": [p.to_dict() for p in self.pairs],
        }


class Contender(Result):
    """A model or a simulator that was compared.

    kind : how a simulator was made. simulator : its id; null for a model that was made here. parameters : fitted
    values, or those of the simulator, by name; effects : those of the simulator, with their values.
    """

    name: str
    kind: str
    simulator: str | None = None
    parameters: dict[str, float] = {}
    effects: dict[str, dict[str, float]] = {}


class Pace(Result):
    """Wall time for a command [us], one by one and all at once, and its ratio to that of the closed form.

    A simulator is timed on its replay of the whole recording; its `one_by_one` is null. fit : seconds that making the
    model took.
    """

    model: str
    one_by_one: float | None
    at_once: float
    one_by_one_ratio: float | None
    at_once_ratio: float
    fit: float


class Paths(Result):
    """How far apart measured and predicted positions are after `commands` commands in a row, over `runs` such runs.

    A prediction begins at the measured pose and adds displacement to displacement. models : {name: errors [cm]}.
    """

    runs: int
    commands: int
    models: dict[str, Spread]


class Way(Result):
    """Points of a path on the ground [m].

    None where a model gives no number, or the place was not measured. Between two measured places it is
    interpolated, but not over a gap that is longer than the command.
    """

    x: tuple[float | None, ...]
    y: tuple[float | None, ...]


class DrivenPath(Result):
    """One run of commands from the test part: the measured way and each model's, at the same times.

    begin, seconds : on the episode's clock, and how long it lasted.
    """

    episode: str
    begin: float
    seconds: float
    measured: Way
    models: dict[str, Way]


class Commands(Result):
    """Models and simulators of a wheeled robot on the commands at the end of a recording, command by command.

    parts : commands to fit, to validate and to test, one after the other. names : in the order in which they were asked
    for, simulators first. best : the least error as a share of the mean displacement, over the three axes. track :
    between the wheels [m], of which commands are told. longest : seconds after which a command counted as another.
    paths : null where the test part has no run of commands without a gap.
    """

    parts: dict[str, int]
    names: tuple[str, ...]
    track: float
    longest: float
    starts: int
    generations: int
    best: str
    errors: Errors
    paths: Paths | None
    driven: tuple[DrivenPath, ...]
    paces: tuple[Pace, ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """Of a displacement, in their order."""
        return tuple(whole.axis for whole in self.errors.variance)

    def rows(self) -> list[dict[str, Any]]:
        found = self.errors.models
        return [
            {"model": name, "axis": axis, **found[name][axis].to_dict()}
            for name in self.names
            for axis in self.axes
        ]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        paths = [(name, self.paths.models[name]) for name in self.names] if self.paths else []
        return self.errors.tables() | {
            "errors": self.rows(),
            "ends of paths": [{"model": name, **spread.to_dict()} for name, spread in paths],
            "time for a command": [pace.to_dict() for pace in self.paces],
        }

    def alike(self, level: float = 0.05) -> tuple[str, ...]:
        """Those that cannot be told from the best one on any axis, by the paired test."""
        apart = {
            name
            for pair in self.errors.pairs
            for name in (pair.first, pair.second)
            if self.best in (pair.first, pair.second) and pair.paired < level
        }
        return tuple(name for name in self.names if name not in {self.best, *apart, *self.errors.seen})

    def __str__(self) -> str:
        found = [(axis, self.errors.models[self.best][axis]) for axis in self.axes]
        means = ", ".join(f"{axis} {spread.mean:.3g} {spread.unit}" for axis, spread in found)
        alike = self.alike()
        others = f"; {' and '.join(alike)} cannot be told from it" if alike else ""
        seen = " and ".join(self.errors.seen)
        others += f"; {seen} may have seen them, and does not count" if seen else ""
        return f"On the last {self.errors.commands} commands, {self.best} is off least ({means} on average){others}"


class Comparison(Result):
    """Simulators of a robot on a recording of it, and models of its commands where it has wheels.

    contenders : all that were compared, simulators first. rollouts : the simulators' held-out errors; null where fewer
    than two were compared. commands : null for robots without wheels. seed : of every draw.
    """

    schema_: Literal["dynreg/comparison/2"] = Field(default="dynreg/comparison/2", alias="schema")
    robot: str
    recording: str
    recording_name: str
    seed: int
    contenders: tuple[Contender, ...]
    rollouts: Rollouts | None
    commands: Commands | None
    notes: tuple[str, ...] = ()
    cost: Cost

    @model_validator(mode="before")
    @classmethod
    def _from_first_version(cls, document: Any) -> Any:
        """A document of version 1 knew wheeled robots alone: what it holds of commands stands in `commands` now."""
        if not isinstance(document, Mapping) or "dynreg/comparison/1" not in (
            document.get("schema"),
            document.get("schema_"),
        ):
            return document
        here = {name: value for name, value in document.items() if name not in ("schema", "schema_")}
        inside = {name: here.pop(name) for name in Commands.model_fields if name in here}
        inside["names"] = [_name(contender) for contender in here.get("contenders", ())]
        return here | {"commands": inside, "rollouts": None}

    def rows(self) -> list[dict[str, Any]]:
        if self.rollouts is not None:
            return [score.to_dict() for score in self.rollouts.scores]
        return self.commands.rows() if self.commands else []

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        scores = [score.to_dict() for score in self.rollouts.scores] if self.rollouts else []
        return {"held-out error": scores} | (self.commands.tables() if self.commands else {})

    def plot(self, channel: str | None = None, ax: "Axes | None" = None) -> "np.ndarray":
        """Held-out error of each simulator against the horizon [s], with 90 % intervals; (1,) matplotlib axes.

        channel : one channel in its unit; by default all together, each in units of its own spread.
        Raises UsageError where no simulators were compared, or for a channel that was not scored.
        """
        found = self.rollouts
        (place,) = places = axes_for(int(found is not None), ax, what="errors of simulators", height=3.5)
        if channel is not None:
            chosen(found.channels, channel, "channel")
        for name in found.names:
            scores = [found.score(name, channel, h.seconds) for h in found.horizons]
            _draw_scores(place, name, [one for one in scores if one is not None])
        label = f"{channel or 'all channels'}, mean absolute error [{found.unit(channel)}]"
        place.set(xlabel="horizon [s]", ylabel=label)
        place.set(title=f"held-out error, {self.recording_name}", xscale="log")
        place.legend(fontsize="small")
        return places

    def __str__(self) -> str:
        said = [str(part) for part in (self.commands, self.rollouts) if part is not None]
        return f"{self.recording_name}: {'. '.join(said)}."


def _draw_scores(ax: "Axes", name: str, scores: list[Score]) -> None:
    """One simulator's errors over the horizons, in the colour of its kind."""
    error = np.array([s.error for s in scores])
    ends = np.array([(s.error, s.error) if s.low is None else (s.low, s.high) for s in scores]).T
    apart = np.abs(ends - error)
    x = [s.seconds for s in scores]
    ax.errorbar(x, error, yerr=apart, marker="o", capsize=3, label=name, **STYLES.get(name.split()[0], {}))


def _name(contender: Any) -> str:
    return contender["name"] if isinstance(contender, Mapping) else contender.name
