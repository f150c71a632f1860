"""The answer of `gait`: joint commands that walk in k simulators, and how well."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Cost, Interval, Result


class GaitGene(Interval):
    """One number of a gait, with the bounds in which it was sought."""


class GaitJoint(Result):
    """What one joint is told [rad]: offset + amplitude sin(2 pi frequency t + phase), faded in from `rest`.

    low, high [rad], speed [rad/s] : the robot's limits, null where it states none.
    """

    action: str
    rest: float
    offset: float
    amplitude: float
    phase: float
    low: float | None
    high: float | None
    speed: float | None


class GaitTrial(Result):
    """The gait in one simulator: its fitness (0 for a fall), and the body's way over the ground [m, rad].

    simulator : id of a registered simulator or entry. time [s] of the points of the way, before a fall.
    contacts : {foot: times [s] between which it is on the ground}.
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
    """The best value after so many candidates, with the motor noise that the search had: a lucky one, most often."""

    evaluations: int
    value: float


class Fitness(Result):
    """The fitness over the simulators, in the task's unit; `quantile` is the lower quartile."""

    min: float
    mean: float
    quantile: float


class GaitFinals(Result):
    """What the answer did with other motor noise, parameters a little off: runs, falls, and the value that it reached.

    value : accepted over the simulators of the mean over draws (0 for a fall).
    """

    runs: int
    falls: int
    value: float


class Gait(Result):
    """Sinusoidal joint commands found by a search in k simulators.

    genes : as the search saw them, by role and leg. joints : what they mean for every joint, `rate` times a second
    for `seconds`, faded in from rest over `ramp` seconds; all that is needed to play the gait.

    recording : that the simulators were chosen for; on : how; source : the stored result that they came from.
    value : what the search raises, by `accept`, of `trials`: one run in each simulator. finals : the runs by which the
    best gaits were chosen from; null where there were none. succeeded : it reached `success` in all simulators and
    fell neither there nor in the finals. ended : why the search ended. notes : what else a reader must know.
    """

    schema_: Literal["dynreg/gait/1"] = Field(default="dynreg/gait/1", alias="schema")
    robot: str
    robot_hash: str
    recording: str
    recording_name: str
    on: str
    k: int
    source: str | None
    task: str
    unit: str
    success: float
    seconds: float
    rate: float
    ramp: float
    frequency: float
    genes: dict[str, GaitGene]
    joints: tuple[GaitJoint, ...]
    accept: Literal["min", "mean", "quantile"]
    value: float
    fitness: Fitness
    finals: GaitFinals | None = None
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

    def rows(self) -> list[dict[str, Any]]:
        return [{"gene": name, **gene.to_dict()} for name, gene in self.genes.items()]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        told = [
            {"simulator": t.simulator[:12], "kind": t.kind, "fitness": t.fitness, "fell": t.fell}
            for t in self.trials
        ]
        return {"": self.rows(), "in the simulators": told}

    def __str__(self) -> str:
        falls = sum(t.fell for t in self.trials)
        if self.succeeded:
            how = "succeeded"
        elif falls:
            how = f"fell in {falls} of {self.k}"
        elif self.finals and self.finals.falls:
            how = f"fell in {self.finals.falls} of {self.finals.runs} runs with other noise"
        else:
            how = "too little"
        simulators = "1 simulator" if self.k == 1 else f"{self.k} simulators"
        return (
            f"{self.recording_name}: {self.task} {self.fitness.min:.3g} {self.unit} at worst, "
            f"{self.fitness.mean:.3g} on average in {simulators}: {how}"
        )
