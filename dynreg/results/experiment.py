"""The answer of `excite`: commands that separate two causes."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


class LimitKept(Result):
    """A limit of the robot in `unit` (low to high), and the range that the commands use (least to most)."""

    name: str
    unit: str
    low: float | None
    high: float | None
    least: float
    most: float


class Experiment(Result):
    """Commands of an experiment that separates two effects, and the expected evidence.

    separation : expected evidence of the true effect over the other [nats]. usual : the same for the usual excitation
    of the same length; null if it was not computed. file : path of the commands. limits : the limits that they keep.
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
            f"{self.seconds:g} s of commands for {self.robot} separate {' from '.join(self.between)}"
            f" by {self.separation:.3g} nats (expected)."
        )
