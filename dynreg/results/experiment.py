"""The answer of `excite`: commands that tell two causes apart."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


class LimitKept(Result):
    """A limit of the robot in `unit`, and what the commands use: low and high are allowed, least and most used."""

    name: str
    unit: str
    low: float | None
    high: float | None
    least: float
    most: float


class Experiment(Result):
    """Commands for an experiment between two effects, and how well it separates them.

    separation : expected nats between the two hypotheses. usual : the same of the usual excitation as long as this
    one; null where it was not computed. file : where the commands were written. limits : what they keep to.
    """

    schema_: Literal["dynreg/experiment/1"] = Field(default="dynreg/experiment/1", alias="schema")
    robot: str
    between: tuple[str, str]
    file: str | None = None
    seconds: float
    separation: float
    usual: float | None = None
    limits: tuple[LimitKept, ...] = ()
    note: str = ""

    def rows(self) -> list[dict[str, Any]]:
        return [limit.to_dict() for limit in self.limits]

    def __str__(self) -> str:
        return (
            f"{self.seconds:g} s of commands for {self.robot} between {' and '.join(self.between)}:"
            f" {self.separation:.3g} nats expected"
        )
