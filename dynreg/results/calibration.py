"""The answer of `calibrate`."""

from typing import Any, Literal

from pydantic import Field, model_validator

from dynreg.adapt.scores import Scores
from dynreg.results.result import Cost, Result


class CalibrationStep(Result):
    """The lowest objective of a stage after so many of its simulations.

    stage : of a version; empty in results of version 1, which had one stage, whose objective is the replay error.
    """

    stage: str = ""
    simulations: int
    error: float


class Fitted(Result):
    """A fitted parameter, in `unit`.

    low, high : 90 % interval; null of a method that gives none (versions before 0.2 wrote the value there). at_bound :
    the value is at the edge of its range. limits : the range (low, high). free : the method could move it; null in
    older documents.
    """

    value: float
    low: float | None = None
    high: float | None = None
    unit: str
    nominal: float
    at_bound: bool = False
    limits: tuple[float, float] | None = None
    free: bool | None = None


class CalibrationVersion(Result):
    """A simulator that the method made on its way.

    simulator : its id. stage : what made it. parent : id of the simulator that it came from; null for the nominal one.
    recordings, episodes : what shaped it: ids and names. before, after : the objective of its stage, at its parent and
    at it; null where the stage has none. unit : of these, "" of a replay error. figures : what else the method tells of
    it, by name. trials : names of the trials on the robot that shaped it.
    """

    simulator: str
    stage: str
    parent: str | None
    recordings: tuple[str, ...]
    episodes: tuple[str, ...]
    before: float | None = None
    after: float | None = None
    unit: str = ""
    figures: dict[str, float] = {}
    trials: tuple[str, ...] = ()


class TriedGait(Scores, Result):
    """A gait on the robot.

    iteration : from 1. step : "transfer" where it came from the simulator, or is one to begin with; "refine" where it
    was changed on the robot. trials : their numbers, from 1. scores : of each, in the task's unit; null for the fall
    that ended them, for which it was discarded. simulated : its fitness in the simulator that it comes from; null
    where it was not run there.
    """

    iteration: int
    step: Literal["transfer", "refine"]
    trials: tuple[int, ...]
    scores: tuple[float | None, ...]
    simulated: float | None = None


class OnRobot(Result):
    """What a method that tries gaits on the robot did there.

    task, unit : what the scores are of. seconds : of one trial. tried : all gaits, in turn. best : number, from 1, of
    that with the highest mean score of those with enough trials. gait : its genes. document : id of the stored gait,
    which `dynreg export` writes. difference : of simulated and real scores, as versions tell it before and after:
    "absolute" the mean absolute one, "signed" the mean one, both in `unit`, or "rank" 1 - their rank correlation, which
    has no unit.
    """

    task: str
    unit: str
    seconds: float
    tried: tuple[TriedGait, ...]
    best: int
    gait: dict[str, float]
    document: str | None = None
    difference: Literal["absolute", "signed", "rank"] = "absolute"

    def scores(self) -> list[float | None]:
        """The score of every trial in turn; None for a fall."""
        return [score for one in self.tried for score in one.scores]


class CalibrationCost(Cost):
    """What a calibration cost.

    resumed : of `rollouts`, those that an interrupted run had left. simulated_seconds : of all rollouts; null of a
    diagnosis, which does not count them. core_seconds : processor time of this run. trials, trial_seconds, falls : on
    the robot, those of an interrupted run included. discarded : of the trials, those of gaits that fell. lost : of the
    trials, those whose outcome nobody knows: an error or a power cut ended them.
    """

    resumed: int = 0
    simulated_seconds: float | None = None
    core_seconds: float | None = None
    trials: int = 0
    trial_seconds: float = 0.0
    falls: int = 0
    discarded: int = 0
    lost: int = 0


class Calibration(Result):
    """A simulator fitted to a recording by a method; by `btr` to the robot itself, and recording and errors are null.

    recording_name : what the recording is called; "" in documents of older versions. seen : episodes of the test part
    that shaped the simulator all the same, by its start or by how the method cuts the recording: the test error is too
    low.

    versions : every simulator that was made on the way, in order; the last is `simulator`. causes : keys of the effects
    that `simulator` has; null of a method that looks for none. Errors are replay errors, 1 as large as the motion, on
    the recording without its held-out part and on that part (null without one). parts : episodes of the fit, select and
    test part; null in results of version 1. ended : why the method ended: "budget", "converged", "nothing to fit",
    "episodes", "plan" where all generations of every stage were run, "iterations", "goal" where a task was met, what
    budget of trials is spent, or the verdict of a diagnosis. population : id of the one that was searched. question :
    hash of the recording, the robot, the method, its settings and the versions of dynreg and MuJoCo, by which a
    finished one is found again; null in older documents.
    """

    schema_: Literal["dynreg/calibration/2"] = Field(default="dynreg/calibration/2", alias="schema")
    robot: str
    recording: str | None
    recording_name: str = ""
    method: str
    simulator: str
    versions: tuple[CalibrationVersion, ...] = ()
    parameters: dict[str, Fitted]
    causes: tuple[str, ...] | None = None
    train_error: float | None
    test_error: float | None
    nominal_train_error: float | None
    nominal_test_error: float | None
    history: tuple[CalibrationStep, ...]
    parts: dict[str, tuple[str, ...]] | None = None
    seen: tuple[str, ...] = ()
    ended: str = ""
    population: str | None = None
    seed: int | None = None
    question: str | None = None
    on_robot: OnRobot | None = None
    cost: CalibrationCost

    @model_validator(mode="before")
    @classmethod
    def _of_version_1(cls, document: Any) -> Any:
        """What version 1 held is a part of version 2."""
        if isinstance(document, dict) and document.get("schema") == "dynreg/calibration/1":
            return document | {"schema": "dynreg/calibration/2"}
        return document

    def rows(self) -> list[dict[str, Any]]:
        return [{"parameter": name, **e.to_dict()} for name, e in self.parameters.items()]

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        made = [
            {
                "stage": v.stage,
                "simulator": v.simulator[:12],
                "before": v.before,
                "after": v.after,
                "unit": v.unit,
                **v.figures,
            }
            for v in self.versions
        ]
        out = {"": self.rows(), "versions": made}
        if self.on_robot is not None:
            out["robot"] = [
                {"gait": n, **one.to_dict(), "score": one.score}
                for n, one in enumerate(self.on_robot.tried, 1)
            ]
        return out
