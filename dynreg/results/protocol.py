"""The answer of `excite --legs`: commands for legs that hang free in turn, and what the operator does."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.experiment import LimitKept
from dynreg.results.result import Result


class ExpectedEvidence(Result):
    """Evidence to expect of an effect of medium size in one joint [nats]."""

    effect: str
    joint: str
    nats: float


class LegCommands(Result):
    """The commands for one leg.

    joints : that move. file : of the commands, in the folder. operator : what to do before and while they are played.
    held_out : the episodes to test by, as `diagnose --hold-out` takes them. expected : from the other episodes.
    """

    leg: str
    joints: tuple[str, ...]
    file: str
    seconds: float
    episodes: tuple[str, ...]
    held_out: tuple[str, ...]
    operator: str
    expected: tuple[ExpectedEvidence, ...] = ()


class LegProtocol(Result):
    """Commands with which legs hang free in turn and reverse, and what the operator does.

    folder : where the files are. stand : the folder of the robot on its stand, by which the logs are diagnosed.
    limits : that the commands keep.
    """

    schema_: Literal["dynreg/protocol/1"] = Field(default="dynreg/protocol/1", alias="schema")
    robot: str
    folder: str | None = None
    stand: str | None = None
    legs: tuple[LegCommands, ...]
    limits: tuple[LimitKept, ...] = ()

    def rows(self) -> list[dict[str, Any]]:
        return [leg.to_dict() for leg in self.legs]

    def __str__(self) -> str:
        seconds = sum(leg.seconds for leg in self.legs)
        many = f"{len(self.legs)} legs" if len(self.legs) != 1 else "one leg"
        return f"{seconds:g} s of commands for {many} of {self.robot}, each hanging free in its turn."
