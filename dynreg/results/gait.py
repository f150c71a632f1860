"""The answer of `gait`: joint commands that walk in k simulators, and their fitness."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, Field, field_validator, model_validator

from dynreg.axes import axes_for
from dynreg.data.units import suffix
from dynreg.results.result import Cost, Interval, Result
from dynreg.search.table import FORMER

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes

OVER = {"min": "at worst", "quantile": "at the lower quartile", "mean": "on average"}
OFTEN = 0.1  # share of runs that fall, above which a gait is not told as a success: by contract
POINTS = 128  # of a period, in the table that a document of version 1 is read as: by contract


class GaitGene(Interval):
    """One number of a gait, with the bounds of the search."""


class GaitJoint(Result):
    """A joint that is told: its angle at rest, and the robot's limits [rad, rad/s], null where it states none."""

    action: str
    rest: float
    low: float | None
    high: float | None
    speed: float | None


class GaitTable(Result):
    """What the joints are told without the ramp: an angle [rad] of each joint at each time [s], evenly in between.

    period : the last time, after which it begins again [s]; null of a motion that ends and holds its last angles.
    targets : a row for each time, in the order of the joints.
    """

    period: float | None
    times: tuple[float, ...]
    targets: tuple[tuple[float, ...], ...]


class GaitTrial(Result):
    """The gait in one simulator: its fitness (0 after a fall), and the path of the body on the ground [m, rad].

    simulator : id of a registered simulator or entry. time : of the points of the path [s], until a fall.
    contacts : {foot: (begin, end) [s] of each contact with the ground}.
    """

    simulator: str
    kind: str
    fitness: float
    fell: bool
    parameters: dict[str, float]
    time: list[float]
    x: list[float]
    y: list[float]
    yaw: list[float]
    contacts: dict[str, list[tuple[float, float]]] = {}


class GaitStep(Result):
    """The best value after so many candidates, under the motor noise of the search; it is biased to high values."""

    evaluations: int
    value: float


class Fitness(Result):
    """The fitness over the simulators, in the task's unit; `quantile` is the lower quartile."""

    min: float
    mean: float
    quantile: float


class GaitFinals(Result):
    """The answer under other motor noise and slightly different parameters: runs, falls, and its value.

    value : `accept` over the simulators, of the mean over draws (a fall counts as 0).
    """

    runs: int
    falls: int
    value: float


class GaitExpected(Result):
    """What the simulators predict of a trial on the robot: the answer under motor noise and parameters, moved a
    little, that the search never saw.

    runs : how many. falls : how many of these fell. low, high : exact 90 % interval of the share that falls.
    median, p5, p95 : of the fitness, in the task's unit; a fall counts as 0.
    """

    runs: int
    falls: int
    low: float
    high: float
    median: float
    p5: float
    p95: float


Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Sine(GaitJoint):
    """A joint as documents of version 1 have it: it is told offset + amplitude sin(2 pi frequency t + phase) [rad]."""

    offset: Finite
    amplitude: Finite
    phase: Finite


class _FirstVersion(BaseModel):
    """What only documents of version 1 have; frequency in periods a second [Hz]."""

    frequency: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    joints: tuple[_Sine, ...]

    def table(self) -> dict[str, Any]:
        """One period."""
        turns = [2 * math.pi * k / POINTS for k in range(POINTS)]
        rows = [[j.offset + j.amplitude * math.sin(turn + j.phase) for j in self.joints] for turn in turns]
        times = [k / POINTS / self.frequency for k in range(POINTS + 1)]
        return {"period": 1.0 / self.frequency, "times": times, "targets": [*rows, rows[0]]}


class Gait(Result):
    """Joint commands found by a search in k simulators.

    kind : the family of gaits. genes : the numbers of the search. table : what every joint is told, sent at `rate` [Hz]
    for `seconds` and faded in from the joints' `rest` over `ramp` [s]; they are all that is needed to play the gait.

    recording : the recording for which the simulators were chosen; null of a gait that was made on the robot
    itself, by `dynreg calibrate --method btr`, whose `fitness` is in the simulator all the same. on : how they
    were chosen. source : the stored result that named them. value : the objective of the search, `accept` over
    `trials` (one run in each simulator). finals : the runs that chose among the best gaits; null if there were
    none. expected : of a trial on the robot; null in results of older versions. packaged : number, from 1, of
    the robot's own gait ([[gait.start]]) that this is, unchanged; null of a new gait. succeeded : the value
    reached `success`, and the gait fell neither there nor in the finals; where the mean or the quartile counts, in
    no more than one of ten such runs. ended : why the search ended. notes : further remarks.
    """

    schema_: Literal["dynreg/gait/2"] = Field(default="dynreg/gait/2", alias="schema")
    robot: str
    robot_hash: str
    recording: str | None
    recording_name: str = ""
    on: str
    k: int
    source: str | None
    task: str
    unit: str
    success: float
    seconds: float
    rate: float
    ramp: float
    kind: str
    genes: dict[str, GaitGene]
    joints: tuple[GaitJoint, ...]
    table: GaitTable
    accept: Literal["min", "mean", "quantile"]
    value: float
    fitness: Fitness
    finals: GaitFinals | None = None
    expected: GaitExpected | None = None
    packaged: int | None = None
    succeeded: bool
    trials: tuple[GaitTrial, ...]
    method: str
    seed: int
    ended: str
    history: tuple[GaitStep, ...]
    evaluations: int
    resumed: int
    notes: tuple[str, ...] = ()
    cost: Cost

    @field_validator("method", mode="before")
    @classmethod
    def _by_its_name(cls, given: object) -> object:
        return FORMER.get(given, given) if isinstance(given, str) else given

    @model_validator(mode="before")
    @classmethod
    def _from_first_version(cls, document: Any) -> Any:
        """A document of version 1 knew sines alone, and stated those of each joint in place of a table.

        Raises ValidationError, as a field of this model does.
        """
        if not isinstance(document, Mapping) or "dynreg/gait/1" not in (
            document.get("schema"),
            document.get("schema_"),
        ):
            return document
        first = _FirstVersion.model_validate(dict(document))
        joints = [joint.model_dump(include={*GaitJoint.model_fields}) for joint in first.joints]
        kept = {
            name: value for name, value in document.items() if name not in ("schema", "schema_", "frequency")
        }
        return kept | {"kind": "sines", "joints": joints, "table": first.table()}

    @property
    def frequency(self) -> float | None:
        """Periods a second [Hz]; None of a motion that is made once."""
        return 1.0 / self.table.period if self.table.period else None

    def rows(self) -> list[dict[str, Any]]:
        return [{"gene": name, **gene.to_dict()} for name, gene in self.genes.items()]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        trials = [
            {"simulator": t.simulator[:12], "kind": t.kind, "fitness": t.fitness, "fell": t.fell}
            for t in self.trials
        ]
        return {"": self.rows(), "trials": trials}

    def plot(self, ax: "Axes | None" = None) -> "np.ndarray":
        """The body's way over the ground [m] in every simulator, seen from above; (1,) matplotlib axes."""
        places = axes_for(min(1, len(self.trials)), ax, what="trials", height=4.0)
        for trial in self.trials:
            end = ", fell" if trial.fell else ""
            places[0].plot(trial.x, trial.y, label=f"{trial.kind} {trial.simulator[:8]}{end}")
        places[0].set(
            xlabel="ahead [m]", ylabel="left [m]", aspect="equal", title=f"{self.task}, {self.seconds:g} s"
        )
        places[0].legend(fontsize="small")
        return places

    def brief(self) -> str:
        value = f"{self.value:.3g}{suffix(self.unit)} {OVER[self.accept]} in {self._where}"
        return f"of {self.robot} for {self.recording_name or 'it'}: {self.task}, {value}"

    @property
    def shown(self) -> int:
        """Number of the simulator that shows the gait: the query's answer, else that in which it walks least."""
        kinds = [one.kind for one in self.trials]
        if "answer" in kinds:
            return kinds.index("answer")
        return min(range(len(kinds)), key=lambda i: self.trials[i].fitness)

    def __str__(self) -> str:
        return f"{self.headline} {self.prediction}".rstrip()

    @property
    def headline(self) -> str:
        """How the gait did in its simulators, in two sentences."""
        falls = sum(t.fell for t in self.trials)
        if self.succeeded and self.often_falls:
            e = self.expected
            how = f"stood here, but fell in {e.falls} of {e.runs} runs with other noise and parameters"
        elif self.succeeded:
            how = "succeeded"
        elif falls:
            how = f"fell in {falls} of {self.k}"
        elif self.finals and self.finals.falls:
            how = f"fell in {self.finals.falls} of {self.finals.runs} runs with other noise"
        else:
            how = f"below the goal of {self.success:.3g}{suffix(self.unit)}"
        unit = suffix(self.unit)
        return (
            f"{self.recording_name or self.robot}: the gait {how}. Task {self.task} in {self._where}: "
            f"{self.fitness.min:.3g}{unit} in the worst, {self.fitness.mean:.3g}{unit} on average."
        )

    @property
    def _where(self) -> str:
        return "1 simulator" if self.k == 1 else f"{self.k} simulators"

    @property
    def often_falls(self) -> bool:
        """Whether a trial on the robot is expected to fall in more than one of ten cases."""
        return self.expected is not None and self.expected.falls > OFTEN * self.expected.runs

    @property
    def prediction(self) -> str:
        """One sentence on what a trial on the robot may bring; "" of a result that does not hold it."""
        e = self.expected
        if e is None:
            return ""
        return (
            f"A trial on the robot may bring {e.median:.3g}{suffix(self.unit)} (90 %: {e.p5:.3g} to {e.p95:.3g}; 0 for "
            f"a fall). It falls with a probability of {100 * e.low:.0f} to {100 * e.high:.0f} %. Both hold as far as "
            "these simulators are right."
        )
