"""The answer of `compare`: how far each model's predictions of displacements are off, and which differ."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Cost, Result


class Spread(Result):
    """Of absolute errors in `unit`."""

    mean: float
    min: float
    max: float
    sd: float
    unit: str


class Pair(Result):
    """Two models on one axis: mean error of the first less that of the second, with its 95 % interval (Tukey).

    tukey : p-value that allows for all pairs and takes the models' errors for independent samples, as the paper's.
    paired : p-value of Wilcoxon's test on the same commands, which they are, by Holm for all pairs of the axis.
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

    models : {name: {axis: errors}}. displacements : {axis: mean absolute displacement}, what the errors are of.
    """

    commands: int
    models: dict[str, dict[str, Spread]]
    displacements: dict[str, float]
    variance: tuple[Variance, ...]
    pairs: tuple[Pair, ...]

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

    kind : of a simulator how it came about. simulator : its id, null for what was made here. parameters : what was
    fitted, or the simulator's values, by name; effects : the simulator's, with their values.
    """

    name: str
    kind: str
    simulator: str | None = None
    parameters: dict[str, float] = {}
    effects: dict[str, dict[str, float]] = {}


class Pace(Result):
    """Wall time for a command [us], one by one and all at once, and how many times the closed form's that is.

    A simulator is timed on its replay of the whole recording: of it `one_by_one` is null. fit : seconds that making the
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

    None where a model says no number, or where the place was not measured. Between two measured places it is
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


class Comparison(Result):
    """Models and simulators of a wheeled robot on the commands at the end of a recording.

    parts : commands to fit, to validate and to test, one after the other. best : the least error as a share of the mean
    displacement, over the three axes. track : between the wheels [m], of which commands are told. longest : seconds
    after which a command counted as another. paths : null where the test part has no run of commands without a gap.
    """

    schema_: Literal["dynreg/comparison/1"] = Field(default="dynreg/comparison/1", alias="schema")
    robot: str
    recording: str
    recording_name: str
    parts: dict[str, int]
    track: float
    longest: float
    seed: int
    starts: int
    generations: int
    contenders: tuple[Contender, ...]
    best: str
    errors: Errors
    paths: Paths | None
    driven: tuple[DrivenPath, ...]
    paces: tuple[Pace, ...]
    notes: tuple[str, ...] = ()
    cost: Cost

    @property
    def names(self) -> tuple[str, ...]:
        """Of those that were compared, in the order in which they were asked for: stored documents are sorted."""
        return tuple(contender.name for contender in self.contenders)

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
        return tuple(name for name in self.names if name != self.best and name not in apart)

    def __str__(self) -> str:
        found = [(axis, self.errors.models[self.best][axis]) for axis in self.axes]
        means = ", ".join(f"{axis} {spread.mean:.3g} {spread.unit}" for axis, spread in found)
        alike = self.alike()
        others = f"; {' and '.join(alike)} cannot be told from it" if alike else ""
        return (
            f"On the last {self.errors.commands} commands of {self.recording_name}, {self.best} is off least"
            f" ({means} on average){others}."
        )
