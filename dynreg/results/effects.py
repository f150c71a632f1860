"""The answer of `effects`: the library of causes that a diagnosis can name."""

from typing import Any, Literal

from pydantic import Field

from dynreg.results.result import Result


class EffectSize(Result):
    """One number of an effect: its sizes are multiples of `per`, a quantity of the robot ("1" for none)."""

    name: str
    unit: str
    meaning: str
    weak: float
    medium: float
    strong: float
    per: str = "1"


class EffectRow(Result):
    """One cause.

    acts_on : the port. group : the other effects that no usual excitation separates from it, at the same joint. near :
    those that a special experiment separates; separate_by : that experiment. applies : whether the robot can have it,
    null where no robot was named.
    """

    id: str
    acts_on: str
    title: str
    parameters: tuple[EffectSize, ...]
    group: tuple[str, ...] = ()
    near: tuple[str, ...] = ()
    separate_by: str = ""
    applies: bool | None = None
    why_not: str | None = None


class EffectsList(Result):
    """The library of effects, in the order in which they act; robot : for which `applies` is told."""

    schema_: Literal["dynreg/effects/1"] = Field(default="dynreg/effects/1", alias="schema")
    robot: str | None = None
    effects: tuple[EffectRow, ...]

    def rows(self) -> list[dict[str, Any]]:
        return [
            {"id": e.id, "acts_on": e.acts_on, "title": e.title, "applies": e.applies, "why_not": e.why_not}
            for e in self.effects
        ]
