"""The answer of gaits tried on a robot, one after the other."""

from typing import Any, Literal

from pydantic import Field

from dynreg.data.units import suffix
from dynreg.results.result import Result


class GaitRound(Result):
    """One gait and its trial on the robot.

    gait : id of the stored gait. simulators : ids of those in which it was sought. told_by : id of the recording that
    the query chose them by; those of earlier rounds may be among them, too. fits : whether the
    log before told where to seek; where not, the simulators of the round before served. median, p5, p95 : the fitness
    that they predict. recording : id of the trial's log; name : its name. packaged : number, from 1, of the robot's own
    gait that this is, unchanged; null of a new one.
    fitness : on the robot, in the task's unit, 0 for a fall. again : the fitness to expect of another trial of the
    gait, by all trials and by simulators; null in older documents, where the registry lacks these, and where an error
    ended the trials.
    """

    gait: str
    simulators: tuple[str, ...]
    told_by: str
    fits: bool
    median: float
    p5: float
    p95: float
    recording: str
    name: str
    packaged: int | None
    fitness: float
    fell: bool
    again: float | None = None

    @property
    def worth(self) -> float:
        """The fitness by which the best is chosen: what to expect of another trial or, without that, this one's."""
        return self.fitness if self.again is None else self.again

    def outcome(self, unit: str) -> str:
        """What the robot did, beside what was predicted."""
        how = "fell" if self.fell else f"stood, {self.fitness:.3g}{suffix(unit)}"
        return f"the robot {how} (predicted {self.median:.3g}, 90 %: {self.p5:.3g} to {self.p95:.3g})"


class GaitRounds(Result):
    """Gaits tried on a robot: after each trial, the query is asked again by the trial's log, and a new gait is sought.

    best : number, from 1, of the round whose gait should do most in another trial, of those that stood; null where all
    fell. Where `again` is null, it is the one that did most.
    seconds : how long the trials lasted. ended : why there were no more.
    """

    schema_: Literal["dynreg/gait_rounds/1"] = Field(default="dynreg/gait_rounds/1", alias="schema")
    robot: str
    recording: str
    recording_name: str
    task: str
    unit: str
    rounds: tuple[GaitRound, ...]
    best: int | None
    seconds: float
    ended: str

    def rows(self) -> list[dict[str, Any]]:
        return [{"round": i + 1, **one.to_dict()} for i, one in enumerate(self.rounds)]

    def brief(self) -> str:
        return f"of {self.robot} for {self.recording_name}: {self.headline}"

    def __str__(self) -> str:
        return f"{self.recording_name}: {self.headline}"

    @property
    def falls(self) -> int:
        """How many trials ended in a fall."""
        return sum(one.fell for one in self.rounds)

    @property
    def headline(self) -> str:
        """How the trials went, in two sentences."""
        many = f"{len(self.rounds)} trial{'s' if len(self.rounds) != 1 else ''} on the robot, {self.falls} with a fall"
        if self.best is None:
            return f"{many}. No gait stood."
        best = self.rounds[self.best - 1]
        more = "" if best.again is None else f"; another trial should reach {best.again:.3g}"
        return f"{many}. The best gait, of trial {self.best}, reached {best.fitness:.3g}{suffix(self.unit)}{more}."
